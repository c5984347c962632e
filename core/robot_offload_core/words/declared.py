"""What a user declares besides outputs and inputs: services, actions, used names, state, conditions.

Each value is checked once, where it is read; the machines rely on it. Sizes are in bytes, durations in seconds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from robot_offload_core.fence.token import Site

MEBIBYTE = 1024 * 1024
LARGEST_SNAPSHOT = 16 * MEBIBYTE
"""Bytes. Largest message of the data session (`maxMessageSize`)."""
_NAME = re.compile(r"/[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_FRAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_/.-]*")
_SERVICE_TYPE = re.compile(r"[a-z][a-z0-9_]*/srv/[A-Z][A-Za-z0-9]*")
_ACTION_TYPE = re.compile(r"[a-z][a-z0-9_]*/action/[A-Z][A-Za-z0-9]*")


class SettingsError(ValueError):
    """A value that cannot work; the message names the setting and what to change."""


class ServiceMode(str, Enum):
    """Who executes a call of a served service (contract of the modes: docs/reference/robotoffload.md)."""

    HOLDER = "Holder"
    """The side that holds, at most once."""
    IDEMPOTENT = "Idempotent"
    """The side that holds; the new one is asked again if it is unknown whether the old one has executed the call."""
    BOTH = "Both"
    """Both sides, so that the replica's state changes too; the answer of the side that holds counts."""
    RACE = "Race"
    """Both sides; the first answer wins."""


WITHOUT_LIMIT_S = 1e9
"""A wait without limit: thirty years."""


class OnSwitch(str, Enum):
    """What happens to an executing goal when the other side begins to act."""

    RESEND_ON_LOSS = "ResendOnLoss"
    """A planned switch waits for the end of the goal; after a loss the other side gets it, and parts may run twice."""
    RESEND = "Resend"
    """The other side gets the goal at each change, so parts may run twice; a goal begun anew twice keeps its side."""
    CONTINUE = "Continue"
    """The other side gets the goal at each change and continues where the robot is: no change costs progress."""
    HOLD = "Hold"
    """A planned switch waits for the end of the goal, at most `hold_for_s`; a loss ends it ABORTED."""
    ABORT = "Abort"
    """The goal ends ABORTED and its client decides."""

    @property
    def resends(self) -> bool:
        """Return whether the other side gets the goal when it begins to act."""
        return self in (OnSwitch.RESEND, OnSwitch.RESEND_ON_LOSS, OnSwitch.CONTINUE)


class Accept(str, Enum):
    """Who answers a client that sends a goal."""

    RELAY = "Relay"
    """The relay on the robot, at once; if the server refuses later, the goal ends ABORTED."""
    HOLDER = "Holder"
    """The server of the side that holds."""


class Priority(str, Enum):
    """Which inputs go first if the link cannot carry all of them."""

    HIGH = "High"
    NORMAL = "Normal"
    LOW = "Low"


@dataclass(frozen=True)
class While:
    """When an output is rated: while one of `actions` is executed, or while messages of `topic` arrive.

    Attributes:
        actions: public names of actions; empty: `topic` decides.
        topic: public name of a topic; "": `actions` decide.
        within_s: how long a message of `topic` keeps the output rated.
    """

    actions: tuple[str, ...] = ()
    topic: str = ""
    within_s: float = 0.0

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        if bool(self.actions) == bool(self.topic):
            raise SettingsError("while: must name either actions or one topic")
        _check_names("while.actions", self.actions)
        if self.topic:
            _check_name("while.topic", self.topic)
            _check_positive("while.within_s", self.within_s)


@dataclass(frozen=True)
class Frame:
    """A transform that the group publishes; only the holder's reaches the public topic."""

    parent: str
    child: str

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        for field, value in (("frames.parent", self.parent), ("frames.child", self.child)):
            if not _FRAME.fullmatch(value):
                raise SettingsError(f"{field}: {value!r} must be a frame's name without a leading slash")
        if self.parent == self.child:
            raise SettingsError(f"frames.child: must differ from its parent, {self.parent!r}")


@dataclass(frozen=True)
class ServiceSpec:
    """A served service: the server is in the group or runs in the cloud, clients are on the robot.

    Attributes:
        name: public name.
        type: `PKG/srv/Name`.
        node: resource name of the node that serves it.
        mode: who executes a call.
        timeout_s: a call that waits longer is answered as a failure.
        core: its node is CORE.
        of_cloud: its node has no replica on the robot and acts by presence (placement Cloud).
        hot: sides on which its node stays Active in standby.
        pooled: its node has several pods, each of which serves it under its own name.
    """

    name: str
    type: str
    node: str = ""
    mode: ServiceMode = ServiceMode.HOLDER
    timeout_s: float = 2.0
    core: bool = False
    of_cloud: bool = False
    hot: tuple[Site, ...] = ()
    pooled: bool = False

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        _check_name("name", self.name)
        _check_type("type", self.type, _SERVICE_TYPE, "PKG/srv/Name")
        _check_positive("timeout_s", self.timeout_s)
        if self.of_cloud and self.mode in (ServiceMode.BOTH, ServiceMode.RACE):
            raise SettingsError(f"mode: must be Holder or Idempotent, there is one replica and no {self.mode.value}")
        if self.pooled and not self.of_cloud:
            raise SettingsError("pooled: must be false, only a node that runs in the cloud alone has several pods")


@dataclass(frozen=True)
class ActionSpec:
    """A served action: the server is in the group or runs in the cloud, clients are on the robot.

    Attributes:
        name: public name.
        type: `PKG/action/Name`.
        on_switch: what happens to a running goal at a change of the holder.
        node: resource name of the node that serves it.
        accept: who answers a client that sends a goal.
        hold_for_s: longest time a commanded change waits for the end of a goal (Hold).
        timeout_s: time from when the holder is able until an unanswered offer ends the goal ABORTED.
        result_timeout_s: how long a result is kept for a client that has not asked for it.
        mirror: live goals are offered to the Hot standby too.
        core: its node is CORE.
        of_cloud: its node has no replica on the robot and acts by presence (placement Cloud).
        hot: sides on which its node stays Active in standby.
    """

    name: str
    type: str
    on_switch: OnSwitch
    node: str = ""
    accept: Accept = Accept.RELAY
    hold_for_s: float = WITHOUT_LIMIT_S
    timeout_s: float = 2.0
    result_timeout_s: float = 900.0
    mirror: bool = False
    core: bool = False
    of_cloud: bool = False
    hot: tuple[Site, ...] = ()

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        _check_name("name", self.name)
        _check_type("type", self.type, _ACTION_TYPE, "PKG/action/Name")
        for field in ("hold_for_s", "timeout_s", "result_timeout_s"):
            _check_positive(field, getattr(self, field))
        if self.mirror and self.on_switch not in (OnSwitch.RESEND, OnSwitch.CONTINUE):
            raise SettingsError("mirror: must be false, only goals with on_switch Resend or Continue may run twice")
        if self.mirror and not self.hot:
            raise SettingsError("mirror: must be false, the action's node is Hot on no side")


@dataclass(frozen=True)
class UsedService:
    """A service that a node of the group calls and that a node outside the group serves.

    Attributes:
        name: public name.
        type: `PKG/srv/Name`.
        node: resource name of the node that calls it.
        timeout_s: a call that waits longer is answered as a failure.
        of_cloud: its node acts by presence (placement Cloud).
    """

    name: str
    type: str
    node: str = ""
    timeout_s: float = 2.0
    of_cloud: bool = False

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        _check_name("name", self.name)
        _check_type("type", self.type, _SERVICE_TYPE, "PKG/srv/Name")
        _check_positive("timeout_s", self.timeout_s)


@dataclass(frozen=True)
class UsedAction:
    """An action that a node of the group uses and that a node outside the group serves.

    Attributes:
        name: public name.
        type: `PKG/action/Name`.
        node: resource name of the node that uses it.
        cancel_after_s: how long the old side's goal runs on after a change of the holder; 0: it is cancelled at once.
        timeout_s: time after which an unanswered offer ends the goal ABORTED.
        of_cloud: its node acts by presence (placement Cloud).
    """

    name: str
    type: str
    node: str = ""
    cancel_after_s: float = 0.5
    timeout_s: float = 2.0
    of_cloud: bool = False

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        _check_name("name", self.name)
        _check_type("type", self.type, _ACTION_TYPE, "PKG/action/Name")
        _check_positive("timeout_s", self.timeout_s)
        if not self.cancel_after_s >= 0:
            raise SettingsError("cancel_after_s: must be at least 0")


@dataclass(frozen=True)
class TopicState:
    """State in a topic: the standby's node gets the newest message that the holder published.

    Attributes:
        node: resource name of the node whose state it is.
        topic: public name of the topic that the node publishes.
        restore: public name of the topic, of the same type, from which the node takes its state.
        type: interface type; "auto": from the graph.
    """

    node: str
    topic: str
    restore: str
    type: str = "auto"

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        _check_name("topic", self.topic)
        _check_name("restore", self.restore)
        if self.topic == self.restore:
            raise SettingsError(f"restore: must differ from topic, {self.topic} would hear itself")


@dataclass(frozen=True)
class ParameterState:
    """State in parameters: values set on the holder are set on the standby.

    Attributes:
        node: resource name of the node whose state it is.
        nodes: names of the nodes whose parameters are copied, including child nodes; empty: the node alone.
        except_: names of parameters that are not copied.
    """

    node: str
    nodes: tuple[str, ...] = ()
    except_: tuple[str, ...] = ()

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        if len(set(self.nodes)) != len(self.nodes):
            raise SettingsError("nodes: must name each node once")


@dataclass(frozen=True)
class SnapshotState:
    """State in bytes that the node itself publishes on `~/offload/state` and takes from `~/offload/restore`.

    Attributes:
        node: resource name of the node whose state it is.
        max_age_s: oldest snapshot with which the standby counts as up to date.
        max_size: bytes; a larger snapshot is refused.
    """

    node: str
    max_age_s: float = 0.5
    max_size: int = MEBIBYTE

    def check(self) -> None:
        """Raise SettingsError naming the first value that cannot work."""
        _check_positive("max_age_s", self.max_age_s)
        if not 0 < self.max_size <= LARGEST_SNAPSHOT:
            raise SettingsError(f"max_size: must be from 1 to {LARGEST_SNAPSHOT} bytes")


StateSpec = TopicState | ParameterState | SnapshotState


def _check_names(field: str, names: tuple[str, ...]) -> None:
    for name in names:
        _check_name(field, name)


def _check_name(field: str, name: str) -> None:
    if not _NAME.fullmatch(name):
        raise SettingsError(f"{field}: {name!r} must be a full name that begins with a slash")


def _check_type(field: str, text: str, pattern: re.Pattern[str], form: str) -> None:
    if not pattern.fullmatch(text):
        raise SettingsError(f"{field}: {text!r} must be {form}")


def _check_positive(field: str, value: float) -> None:
    if not value > 0:
        raise SettingsError(f"{field}: must be greater than 0")
