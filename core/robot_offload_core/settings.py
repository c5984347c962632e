"""What a user sets, in seconds, checked once for values that cannot work together."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from robot_offload_core.token import Site

DRIFT_SHARE = 1e-3
"""Margin for two steady clocks running at different speeds: 1000 ppm, ten times what a bad quartz does."""


class SettingsError(ValueError):
    """A value that cannot work; the message names the setting and says what to change."""


class Mode(str, Enum):
    """`Auto` switches; `Observe` measures, decides and says what it would do, but never switches."""

    AUTO = "Auto"
    OBSERVE = "Observe"


@dataclass(frozen=True)
class Settings:
    """All timing of the switch. Every duration in seconds.

    Attributes:
        beat_period_s: distance of two beats.
        loss_timeout_s: silence of good beats that means loss.
        lease_s: how long a grant lets the cloud act, from the sending of the beat that it echoes.
        max_command_age_s: oldest cloud message that may reach a consumer.
        robot_period_s: period of the robot's replica; `cloud_period_s`: of the cloud's; with
        tolerance_s: they give the loop latency that the cloud may have: t_l + t_c_cloud <= t_c_robot + tolerance.
        min_dwell_s: least stay before a switch that only the policy asks for.
        activation_deadline_s: in which a side's nodes must become Active.
        hold_down_initial_s: wait before the cloud is used again after a loss; doubled by each flap up to
        hold_down_max_s: ; a stay in the cloud shorter than flap_window_s is a flap.
        max_clock_offset_s: largest difference of the two system clocks (user nodes compare stamps).
        manual_hold_s: how long a switch by hand outweighs the policy.
        prefer: the side to be on when both can act.
        pin: from the resource; None = policy decides.
        mode: see Mode.
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

    @property
    def allowed_loop_s(self) -> float:
        """Round trip that the cloud may have and still be worth it (the thesis's rule solved for t_l)."""
        return self.robot_period_s + self.tolerance_s - self.cloud_period_s

    @property
    def echo_limit_s(self) -> float:
        """Oldest echo of one of our beats that still proves a living loop."""
        return self.loss_timeout_s + self.allowed_loop_s

    @property
    def drift_s(self) -> float:
        """Margin that the robot adds to a lease before it takes the cloud for stopped."""
        return self.lease_s * DRIFT_SHARE + 0.001

    @property
    def slower_period_s(self) -> float:
        """The longer of the two replicas' periods."""
        return max(self.robot_period_s, self.cloud_period_s)

    def check(self) -> None:
        """Raises SettingsError naming the first setting that cannot work."""
        for name in ("beat_period_s", "loss_timeout_s", "lease_s", "max_command_age_s", "robot_period_s",
                     "cloud_period_s", "activation_deadline_s"):  # fmt: skip
            if not getattr(self, name) > 0:
                raise SettingsError(f"{name}: must be greater than 0")
        if self.loss_timeout_s < 2 * self.beat_period_s:
            raise SettingsError("loss_timeout_s: must be at least two beat periods, one lost beat is normal")
        if self.allowed_loop_s <= 0:
            raise SettingsError("tolerance_s: robot period + tolerance - cloud period must be greater than 0")
        if self.lease_s < self.echo_limit_s + 2 * self.beat_period_s - 1e-9:
            raise SettingsError(
                f"lease_s: must be at least {self.echo_limit_s + 2 * self.beat_period_s:.3f} "
                "(loss timeout + allowed loop latency + two beats)"
            )
        if self.max_command_age_s <= self.allowed_loop_s + self.beat_period_s:
            raise SettingsError(
                f"max_command_age_s: must exceed {self.allowed_loop_s + self.beat_period_s:.3f} "
                "(allowed loop latency + one beat)"
            )


@dataclass(frozen=True)
class OutputSpec:
    """A collected output. `deadline_s` 0 means not rated: its silence is never judged."""

    name: str
    deadline_s: float = 0.150


@dataclass(frozen=True)
class InputSpec:
    """A topic to the cloud. `max_age_s` 0 means no limit."""

    name: str
    max_age_s: float = 0.0


@dataclass(frozen=True)
class NodeSpec:
    """A managed node of one side, in bring-up order of its list.

    Attributes:
        name: resource name, the same on both sides (the cloud's replica is called remote_NAME in ROS).
        duplicated: has a replica on the other side and follows the placement.
        core: without it the robot must not move.
        lifecycle: is a managed node; others are only started and watched.
        hot: stays Active while the other side acts (its outputs are held back by the collector or the egress).
    """

    name: str
    duplicated: bool = True
    core: bool = False
    lifecycle: bool = True
    hot: bool = False
