"""What a user sets, in seconds; checked once for values that cannot work together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from robot_offload_core.fence.token import Site
from robot_offload_core.words.declared import MEBIBYTE, Frame, Priority, SettingsError, While

DRIFT_SHARE = 0.2
"""Margin for two steady clocks running at different speeds.

A quartz is off by 0.01 %, but chrony slews a clock by up to 83,333 ppm (its `maxslewrate`), and with it the steady
clock that times leases: two hosts slewed apart differ by (1 + 0.0833) / (1 - 0.0833) = 1.18.
"""


STALL_BEATS = 2.5
STALL_LEAST_S = 0.050
"""Two turns of a control process (20 ms) and its slack (10 ms)."""
PAUSE_MOST_S = 0.150
"""Longest gap between steps of the cloud after which its lease stays valid (see pause_s)."""
ROBOT_LIVE_LEAST_S = 1.0
"""Least silence after which another incarnation of the robot may be served."""
LOOKS_S = 0.060
"""Shortest deadline of an output that can be judged, because a look of the collector may be late."""
LARGEST_MESSAGE = 16 * MEBIBYTE
"""Bytes. Largest message that the agent's processes hand over in one piece."""


class Mode(str, Enum):
    """`Auto` switches; `Observe` measures, decides and reports what it would do, but never switches."""

    AUTO = "Auto"
    OBSERVE = "Observe"


@dataclass(frozen=True)
class Settings:
    """All timing of the switch. Every duration in seconds.

    Attributes:
        beat_period_s: time between two beats.
        loss_timeout_s: silence of good beats that means loss.
        lease_s: how long a grant lets the cloud act, from the sending of the beat that it echoes.
        max_command_age_s: oldest cloud message that may reach a consumer.
        robot_period_s: period of the robot's replica.
        cloud_period_s: period of the cloud's replica.
        tolerance_s: bounds the loop latency of the cloud: t_l + t_c_cloud <= t_c_robot + tolerance.
        min_dwell_s: least stay before a switch that only the policy asks for.
        activation_deadline_s: time in which a side's nodes must become Active.
        hold_down_initial_s: wait before the cloud is used again after a loss; each flap doubles it.
        hold_down_max_s: longest such wait.
        flap_window_s: a shorter stay in the cloud is a flap.
        max_clock_offset_s: largest difference of the two system clocks (user nodes compare stamps).
        manual_hold_s: how long a switch by hand outweighs the policy.
        prefer: the side to use when both can act.
        pin: from the resource; None: the policy decides.
        mode: see Mode.
        prepare_deadline_s: time in which a side that gets ready without a loss must have nodes, goals and state; 0: the
            activation deadline (see `preparing_s`).
        cancel_deadline_s: time in which the old side's goals end after a change, before its nodes are deactivated.
        settle_for_s: how long a side stays Active after it was called off for its goals or state.
        max_message_size: bytes of the largest message that is carried.
    """

    beat_period_s: float = 0.020
    loss_timeout_s: float = 0.090
    lease_s: float = 0.250
    max_command_age_s: float = 0.150
    robot_period_s: float = 0.050
    cloud_period_s: float = 0.020
    tolerance_s: float = 0.030
    min_dwell_s: float = 0.0
    activation_deadline_s: float = 0.250
    hold_down_initial_s: float = 1.0
    hold_down_max_s: float = 30.0
    flap_window_s: float = 5.0
    max_clock_offset_s: float = 0.020
    manual_hold_s: float = 30.0
    prefer: Site = Site.CLOUD
    pin: Site | None = None
    mode: Mode = field(default=Mode.AUTO)
    prepare_deadline_s: float = 0.0
    cancel_deadline_s: float = 2.0
    settle_for_s: float = 10.0
    max_message_size: int = 8 * MEBIBYTE

    @property
    def allowed_loop_s(self) -> float:
        """Return the longest round trip at which the cloud is worth using (the thesis's rule solved for t_l)."""
        return self.robot_period_s + self.tolerance_s - self.cloud_period_s

    @property
    def echo_limit_s(self) -> float:
        """Return the greatest age of an echo of our beats that still proves a living loop."""
        return self.loss_timeout_s + self.allowed_loop_s

    @property
    def drift_s(self) -> float:
        """Return the margin that the robot adds to a lease before it assumes that the cloud has stopped."""
        return self.lease_s * DRIFT_SHARE + 0.001

    @property
    def slower_period_s(self) -> float:
        """Return the longer of the two replicas' periods."""
        return max(self.robot_period_s, self.cloud_period_s)

    # Further values derived from those above. At the default beat period these are the figures in the docs.

    @property
    def stall_s(self) -> float:
        """Return the longest gap between own steps; a longer one is our stall, not silence of the link.

        It is 2.5 beats, and more than two turns. Where turns allow it, it is less than the loss timeout, so that a
        stall is noticed before it looks like a loss.
        """
        return max(STALL_LEAST_S, min(STALL_BEATS * self.beat_period_s, self.loss_timeout_s / 2))

    @property
    def pause_s(self) -> float:
        """Return the gap between own steps of the cloud above which its lease is void.

        It is many turns long, and shorter than a lease where turns allow it.
        """
        return max(STALL_LEAST_S, min(PAUSE_MOST_S, 0.6 * self.lease_s))

    @property
    def robot_live_s(self) -> float:
        """Return the silence after which a robot is no longer live, so that another incarnation may be served."""
        return max(ROBOT_LIVE_LEAST_S, self.loss_timeout_s + 2 * self.beat_period_s)

    @property
    def preparing_s(self) -> float:
        """Return how long a side may take to get ready without a loss: nodes, goals, requests and state."""
        return self.prepare_deadline_s or self.activation_deadline_s

    def check(self) -> None:
        """Raise SettingsError naming the first setting that cannot work."""
        for rule in RULES:
            message = rule.broken(self)
            if message:
                raise SettingsError(f"{rule.path}: {message}")


@dataclass(frozen=True)
class Rule:
    """A condition that settings must meet to work together.

    Attributes:
        path: the setting to change.
        broken: returns what that setting must be; "" if the condition is met.
    """

    path: str
    broken: Callable[[Settings], str]


EPSILON_S = 1e-9
"""Values arrive as whole milliseconds; their sums as floating-point numbers differ by less."""


def _positive(name: str) -> Rule:
    return Rule(name, lambda s: "" if getattr(s, name) > 0 else "must be greater than 0")


def _loss_timeout(s: Settings) -> str:
    holds = s.loss_timeout_s > 2 * s.beat_period_s + EPSILON_S
    return "" if holds else "must be more than two beat periods, one lost beat is normal"


def _tolerance(s: Settings) -> str:
    return "" if s.allowed_loop_s > EPSILON_S else "robot period + tolerance - cloud period must be greater than 0"


def _lease(s: Settings) -> str:
    least_s = s.echo_limit_s + 2 * s.beat_period_s
    if s.lease_s >= least_s - EPSILON_S:
        return ""
    return f"must be at least {least_s:.3f} (loss timeout + allowed loop latency + two beats)"


def _prepare_deadline(s: Settings) -> str:
    holds = not s.prepare_deadline_s or s.prepare_deadline_s >= s.activation_deadline_s
    return "" if holds else "must be at least the activation deadline, nodes become Active within it"


def _hold_down(s: Settings) -> str:
    return "" if s.hold_down_initial_s <= s.hold_down_max_s else "must not exceed hold_down_max_s, which it grows to"


def _settle_for(s: Settings) -> str:
    return "" if s.settle_for_s >= 0 else "must be at least 0"


def _max_message_size(s: Settings) -> str:
    holds = 0 < s.max_message_size <= LARGEST_MESSAGE
    return "" if holds else f"must be from 1 to {LARGEST_MESSAGE} bytes"


def _max_command_age(s: Settings) -> str:
    least_s = s.allowed_loop_s + s.beat_period_s
    return (
        ""
        if s.max_command_age_s > least_s + EPSILON_S
        else f"must exceed {least_s:.3f} (allowed loop latency + one beat)"
    )


RULES: tuple[Rule, ...] = (
    *map(_positive, (
        "beat_period_s", "loss_timeout_s", "lease_s", "max_command_age_s", "robot_period_s", "cloud_period_s",
        "activation_deadline_s", "cancel_deadline_s",
    )),
    Rule("loss_timeout_s", _loss_timeout),
    Rule("tolerance_s", _tolerance),
    Rule("lease_s", _lease),
    Rule("max_command_age_s", _max_command_age),
    Rule("prepare_deadline_s", _prepare_deadline),
    Rule("hold_down_initial_s", _hold_down),
    Rule("settle_for_s", _settle_for),
    Rule("max_message_size", _max_message_size),
)  # fmt: skip
"""Checked in this order; the first broken one is named."""


@dataclass(frozen=True)
class OutputSpec:
    """An output that reaches the robot's public topic.

    Attributes:
        name: identifier of the output.
        deadline_s: silence that means a fault; 0: not rated, silence is never judged.
        period_s: time between two messages; 0: unknown.
        while_: when the output is rated; None: always, unless `deadline_s` is 0.
        shared: other publishers on the public topic are allowed.
        frames: the transforms of the group on /tf; they imply `shared`.
        of_cloud: its node has placement Cloud: no replica on the robot, passes by presence and age.
        max_age_s: oldest message that passes; 0: `Settings.max_command_age_s`.
        nodes: resource names of the nodes that publish it.
        hot: sides on which all of these nodes stay Active in standby.
        waits: one of these nodes has used names, so its first message comes after the changeover.
        topic: public topic, the name that people know.
        latched: its publisher keeps the last message for late subscribers (transient local).
    """

    name: str
    deadline_s: float = 0.150
    period_s: float = 0.0
    while_: While | None = None
    shared: bool = False
    frames: tuple[Frame, ...] = ()
    of_cloud: bool = False
    max_age_s: float = 0.0
    nodes: tuple[str, ...] = ()
    hot: tuple[Site, ...] = ()
    waits: bool = False
    topic: str = ""
    latched: bool = False

    @property
    def shown(self) -> str:
        """Return the output's name in messages to people: its topic, else its identifier."""
        return self.topic or self.name

    @property
    def rated(self) -> bool:
        """Return whether the silence of a side's replica is judged."""
        return self.deadline_s > 0 and not self.of_cloud

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        if problem := self.problem():
            raise SettingsError(f"deadline_s: {problem}")
        if self.while_ is not None:
            self.while_.check()
            if not self.deadline_s:
                raise SettingsError("while: needs a rate, an output without one is never judged")
            if self.while_.within_s >= self.deadline_s:
                raise SettingsError(
                    "while.within_s: must be less than the deadline, else the topic's end looks like a fault"
                )
        for frame in self.frames:
            frame.check()
        if len({frame.child for frame in self.frames}) != len(self.frames):
            raise SettingsError("frames.child: must be named once, a frame has one parent")
        if self.frames and not self.shared:
            raise SettingsError("shared: must be true, /tf has other publishers")
        if not self.max_age_s >= 0:
            raise SettingsError("max_age_s: must be at least 0")

    def problem(self) -> str:
        """Return why its deadline is not valid; "" if it is."""
        if not self.deadline_s or self.deadline_s > self.period_s:
            return ""
        return f"must exceed the period, {self.period_s * 1e3:g} ms at {1 / self.period_s:g} Hz"

    def too_tight(self) -> str:
        """Return why its deadline may be missed although all is well; "" if it can be kept."""
        if not 0 < self.deadline_s < LOOKS_S:
            return ""
        return f"should be at least {LOOKS_S * 1e3:g} ms: a look of the collector may be late"


@dataclass(frozen=True)
class InputSpec:
    """A topic to the cloud.

    Attributes:
        name: the topic.
        max_age_s: oldest message that counts as fresh; 0: no limit.
        max_rate_hz: messages above this rate are left out; 0: no limit.
        min_rate_hz: the agent thins the topic down to this rate if the link carries no more; 0: never thinned.
        priority: what goes first if the link cannot carry everything.
        latest: a newer message replaces an older one that has not been sent yet.
    """

    name: str
    max_age_s: float = 0.0
    max_rate_hz: float = 0.0
    min_rate_hz: float = 0.0
    priority: Priority = Priority.NORMAL
    latest: bool = False

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        for name in ("max_age_s", "max_rate_hz", "min_rate_hz"):
            if not getattr(self, name) >= 0:
                raise SettingsError(f"{name}: must be at least 0")
        if self.max_rate_hz and self.min_rate_hz > self.max_rate_hz:
            raise SettingsError(f"min_rate_hz: must not exceed max_rate_hz, {self.max_rate_hz:g} Hz")

    def too_tight(self, settings: Settings) -> str:
        """Return why its limit is broken even on a good link; "" if it can be kept there."""
        least_s = settings.allowed_loop_s + settings.beat_period_s
        if not self.max_age_s or self.max_age_s > least_s:
            return ""
        return f"should exceed {least_s * 1e3:g} ms, or every message is too old (allowed loop latency + one beat)"


@dataclass(frozen=True)
class NodeSpec:
    """A managed node of one side, in bring-up order of its list.

    Attributes:
        name: resource name, the same on both sides (the cloud's replica is called remote_NAME in ROS).
        duplicated: it has a replica on the other side and follows the placement.
        core: without it the robot must not move.
        lifecycle: it is a managed node; others are only started and watched.
        hot: it stays Active while the other side acts (the collector or the egress holds its outputs back).
        names: private names of its outputs, services and actions on this side; a node without a lifecycle is alive
            only while its process and all of these are seen.
    """

    name: str
    duplicated: bool = True
    core: bool = False
    lifecycle: bool = True
    hot: bool = False
    names: tuple[str, ...] = ()

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        if self.duplicated and not self.lifecycle and not self.hot:
            raise SettingsError("hot: must be true, a node without a lifecycle is active on both sides")
