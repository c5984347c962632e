"""The state of one robot at one moment, from any source. Values only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

ROBOT: Final = "robot"
CLOUD: Final = "cloud"
UNKNOWN: Final = "unknown"
SITES: Final = (ROBOT, CLOUD, UNKNOWN)


@dataclass(frozen=True, slots=True, order=True)
class Key:
    """A RobotOffload's Kubernetes namespace (empty outside a cluster) and name."""

    namespace: str
    name: str

    def __str__(self) -> str:
        return f"{self.namespace}/{self.name}" if self.namespace else self.name


@dataclass(frozen=True, slots=True)
class NodeState:
    """One replica: its node, side, lifecycle state, and standby (Hot, Configured; empty: unknown)."""

    name: str
    side: str
    state: str
    standby: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class TopicFlow:
    """What crossed the link, or reached the consumers, of one topic.

    Attributes:
        topic: its public name.
        messages: since the start; None: not counted.
        size_bytes: since the start; None: not counted.
        age_ms: of the newest message when it arrived; None: not known.
        left_out: thinned and refused messages, as text; empty: none, or not counted.
    """

    topic: str
    messages: int | None = None
    size_bytes: int | None = None
    age_ms: float | None = None
    left_out: str = ""


@dataclass(frozen=True, slots=True)
class Errand:
    """A goal, or a service with calls: its name, its state, and the figures as text."""

    name: str
    state: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Changeover:
    """A change of the active side.

    Attributes:
        t_s: its time.
        to: the side that acts from then on.
        reason, message: why.
        gap_ms: the consumers' gap around it; None: not known.
    """

    t_s: float
    to: str
    reason: str
    message: str = ""
    gap_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Live:
    """The agents' report about one robot at one moment.

    Attributes:
        site: the active side: robot, cloud or unknown.
        reason, message: why, as one word and as a sentence.
        epoch: number of the present changeover.
        connected: whether the robot's agent is heard.
        latency_ms: loop latency of the link now; None: cut, or not known.
        cut: the link is known to carry nothing.
        loss_share: of the heartbeats of the last seconds, 0 to 1; None: not known.
        p50_ms, p99_ms: the round trip's quantiles; None: not known.
        last: the last changeover, with its time in seconds before this moment (negative); None: not known.
        nodes, topics, goals, services: as far as the source knows them.
        state_ages_ms: age of the state with which the active side continued, by name.
        numbers: further figures of the robot, name and value, for people.
        note: what a person should know about the origin of these numbers; empty: nothing.
    """

    site: str = UNKNOWN
    reason: str = ""
    message: str = ""
    epoch: int = 0
    connected: bool = False
    latency_ms: float | None = None
    cut: bool = False
    loss_share: float | None = None
    p50_ms: float | None = None
    p99_ms: float | None = None
    last: Changeover | None = None
    nodes: tuple[NodeState, ...] = ()
    topics: tuple[TopicFlow, ...] = ()
    goals: tuple[Errand, ...] = ()
    services: tuple[Errand, ...] = ()
    state_ages_ms: tuple[tuple[str, float], ...] = ()
    numbers: tuple[tuple[str, str], ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class Point:
    """One moment of the strips: seconds, loop latency, its p99, loss, side; cut: nothing came through."""

    t_s: float
    latency_ms: float | None
    p99_ms: float | None
    loss_share: float | None
    site: str
    cut: bool = False


@dataclass(frozen=True, slots=True)
class Bounds:
    """The numbers of the rule that are drawn and named.

    Attributes:
        allowed_ms: loop latency up to which the cloud is worth using; None: not known.
        loss_timeout_ms: silence that counts as a loss; None: not known.
        hold_down_s: first and longest wait after a loss; None: not known.
    """

    allowed_ms: float | None = None
    loss_timeout_ms: float | None = None
    hold_down_s: tuple[float, float] | None = None


NOTHING: Final = Live()
NO_BOUNDS: Final = Bounds()


@dataclass(frozen=True, slots=True)
class Moment:
    """A kept report of the agents, to scroll back to."""

    t_s: float
    live: Live = field(default_factory=Live)
