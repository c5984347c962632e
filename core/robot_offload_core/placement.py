"""The words of the robot's placement machine: its phases, state, events and commands. `switcher.step` joins them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from robot_offload_core.beats import Beat, CloudReport, Permission
from robot_offload_core.collectors import Gate, GateReport
from robot_offload_core.events import Acting, Tick
from robot_offload_core.health import Situation
from robot_offload_core.links import Link
from robot_offload_core.policies import Policy
from robot_offload_core.reasons import Reason, Verdict
from robot_offload_core.settings import InputSpec, Settings
from robot_offload_core.token import Site


class Phase(str, Enum):
    """Who acts and what is under way.

    ROBOT: the robot acts. TO_CLOUD: it acts while the cloud gets ready under a candidate epoch. CLOUD: the cloud acts.
    TO_ROBOT: it acts while the robot's nodes wake. TAKEOVER: the robot is in charge after a sudden loss, its CORE nodes
    are still waking.
    """

    ROBOT = "Robot"
    TO_CLOUD = "ToCloud"
    CLOUD = "Cloud"
    TO_ROBOT = "ToRobot"
    TAKEOVER = "Takeover"


IN_CHARGE = {
    Phase.ROBOT: Site.ROBOT,
    Phase.TO_CLOUD: Site.ROBOT,
    Phase.CLOUD: Site.CLOUD,
    Phase.TO_ROBOT: Site.CLOUD,
    Phase.TAKEOVER: Site.ROBOT,
}


STARTING = Verdict(Site.ROBOT, Reason.STARTING, "The robot acts; the cloud has not been heard yet")


@dataclass(frozen=True)
class Wish:
    """A site asked for by a person, until a time (None: until taken back)."""

    site: Site
    until_s: float | None = None

    def holds(self, now_s: float) -> bool:
        """Whether it still stands."""
        return self.until_s is None or now_s < self.until_s


@dataclass(frozen=True)
class CloudLeaving:
    """The cloud's pods are going: the robot is to act, and not to choose this cloud again before `until_s`.

    Attributes:
        cloud: incarnation of the cloud that said so; another one is chosen as soon as it is heard.
    """

    cloud: str
    until_s: float


@dataclass(frozen=True)
class Robot:
    """State of the robot's control process. Times on its steady clock, seconds.

    Attributes:
        incarnation, started_us: of this control process.
        settings, inputs: from the configuration. asked: settings that are to hold as soon as that is safe (settling).
        link: health of the link to the cloud addressed.
        policy: state of the rule.
        phase, since_s: the present phase and when it began. charged_s: when the side in charge last changed.
        partner: incarnation of the cloud that is (to be) in charge.
        epoch: of the side in charge. candidate: of the side that gets ready; 0 = none. last_epoch: highest used.
        deadline_s: of the present preparation.
        armed: the collector may change over at the candidate's first messages. offered: it was told so once in this
        preparation of the cloud, and may have done it even if told otherwise since.
        failures, retry_s: called-off preparations in a row; no new one before retry_s.
        good_s: arrival of the newest good beat of the stay in charge.
        situation: everything heard besides the link, see Situation.
        nodes_ready: the robot's CORE nodes are Active; ready_since_s: since when not, for the return at once.
        clear_s: from when the cloud has stopped for sure; None: reckoned from the start of this process.
        pin: on the robot; manual: the last switch by hand; leaving: what the cloud said of its end.
        stepped_s, stall_until_s: own steps, and until when silence is not judged after a stall.
        fell_at_s: when the robot became unable to act; None while able.
        decided, decided_s: the last decision told, and when.
        told_s: when the levels were last told.
    """

    incarnation: str
    started_us: int
    settings: Settings
    inputs: tuple[InputSpec, ...] = ()
    link: Link = Link()
    policy: Policy = Policy()
    phase: Phase = Phase.ROBOT
    since_s: float = 0.0
    charged_s: float = 0.0
    partner: str = ""
    epoch: int = 1
    candidate: int = 0
    last_epoch: int = 1
    deadline_s: float = 0.0
    armed: bool = False
    offered: bool = False
    failures: int = 0
    retry_s: float = 0.0
    situation: Situation = Situation()
    nodes_ready: bool = False
    clear_s: float | None = None
    pin: Wish | None = None
    manual: Wish | None = None
    leaving: CloudLeaving | None = None
    asked: Settings | None = None
    stepped_s: float | None = None
    stall_until_s: float = 0.0
    fell_at_s: float | None = None
    decided: Verdict = STARTING
    decided_s: float = 0.0
    told: tuple[object, ...] = ()
    told_s: float = -1.0


@dataclass(frozen=True)
class CloudBeat:
    """A beat of the cloud arrived, as told by the pulse process. `wall_us`: system clock minus steady clock here."""

    beat: Beat
    arrived_s: float
    wall_us: int


@dataclass(frozen=True)
class PulseSent:
    """The pulse process sent a beat; `granted` when it carried a grant."""

    sent_s: float
    granted: bool


@dataclass(frozen=True)
class GateReported:
    """The collector reported."""

    report: GateReport


@dataclass(frozen=True)
class DataReported:
    """The data process reported: session, age of the newest probe, incarnation of the cloud's control seen there."""

    connected: bool
    age_s: float | None
    cloud: str


@dataclass(frozen=True)
class NodesReported:
    """The guardian reported whether the robot's duplicated CORE nodes are Active."""

    ready: bool


@dataclass(frozen=True)
class SwitchByHand:
    """One of the four services was called. `key` comes back with the answer."""

    site: Site
    key: int = 0


@dataclass(frozen=True)
class SetPin:
    """The pin on the robot was set (or cleared with None)."""

    pin: Wish | None


@dataclass(frozen=True)
class SetSettings:
    """Settings were changed at run time."""

    settings: Settings
    inputs: tuple[InputSpec, ...]


Event = (
    CloudBeat | PulseSent | GateReported | DataReported | NodesReported | SwitchByHand | SetPin | CloudLeaving
    | SetSettings | Tick
)  # fmt: skip


@dataclass(frozen=True)
class Permit:
    """Level, to the pulse process."""

    permission: Permission


@dataclass(frozen=True)
class SetGate:
    """Level, to the collector."""

    gate: Gate


@dataclass(frozen=True)
class Reopen:
    """To pulse and data: drop the sessions with everything buffered in them."""

    reason: Reason


@dataclass(frozen=True)
class Decided:
    """For log, diagnostics and /offload/placement.

    Attributes:
        site, epoch: who is in charge now.
        phase: see Phase.
        verdict: reason and message of the change.
        switched: the side in charge changed.
        silent_s: since the last good beat, at a sudden loss; None for a commanded change.
    """

    site: Site
    epoch: int
    phase: Phase
    verdict: Verdict
    switched: bool
    silent_s: float | None = None


@dataclass(frozen=True)
class Answer:
    """The answer to a switch by hand."""

    key: int
    accepted: bool
    message: str


Command = Permit | SetGate | Acting | Reopen | Decided | Answer


def is_good(robot: Robot, beat: Beat, arrived_s: float) -> bool:
    """Current token, a living loop, and the cloud acts under my epoch (protocol section 1)."""
    report = beat.body
    if not isinstance(report, CloudReport) or beat.echo is None or beat.echo.incarnation != robot.incarnation:
        return False
    return (
        beat.incarnation == robot.link.peer
        and report.serves == robot.incarnation
        and report.epoch == (robot.candidate if robot.phase is Phase.TO_CLOUD else robot.epoch)
        and report.acting
        and arrived_s - beat.echo.sent_us / 1e6 <= robot.settings.echo_limit_s
    )
