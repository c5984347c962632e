"""The robot's placement machine: its phases, state, events and commands. `switcher.step` connects them."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.control.robot.health import Situation
from robot_offload_core.fence.grant import Grant
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.link.links import Link
from robot_offload_core.link.policies import Policy
from robot_offload_core.words.beats import Beat, Permission
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import Acting, DataReported, StateReported, Tick
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.messages import PulseSent, Reopen, SetGate
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.settings import InputSpec, OutputSpec, Settings
from robot_offload_core.words.slow_outputs import SlowOutput, is_slow

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
        """Return whether the wish still holds."""
        return self.until_s is None or now_s < self.until_s


@dataclass(frozen=True)
class CloudLeaving:
    """The cloud's pods are stopping: the robot is to act, and not to choose this cloud again before `until_s`.

    Attributes:
        cloud: incarnation of the cloud that announced it; another one may be chosen as soon as it is heard.
    """

    cloud: str
    until_s: float


@dataclass(frozen=True)
class Preparation:
    """A side that gets ready to take over.

    Attributes:
        deadline_s: called off when the collector has not changed over by then.
        armed: the collector may change over at the candidate's first messages.
        need: the robot cannot act; nobody asked for the changeover.
        prompt: the side that acts cannot, or must not (a veto), so that nobody waits for slow outputs.
        patient_until_s: so long a change that a person or a pin asked for waits for goals, requests and state.
    """

    deadline_s: float
    armed: bool = False
    need: bool = False
    prompt: bool = False
    patient_until_s: float = 0.0


@dataclass(frozen=True)
class RelayReported:
    """The robot's relay reported: what the side that gets ready under `candidate` lacks, and what a change waits for.

    Attributes:
        candidate: token of the preparation that `pending` is about.
        pending: (reason, message) of everything that is missing.
        hold: an action with a goal that must not be interrupted; "" for none.
        hold_for_s: how long a change waits for it.
        unfit: a mirror on the robot ended long before its goal: the robot must not take over by silence.
    """

    candidate: Token | None
    pending: tuple[tuple[str, str], ...] = ()
    hold: str = ""
    hold_for_s: float = 0.0
    unfit: bool = False


@dataclass(frozen=True)
class Handing:
    """What is handed over besides outputs.

    Attributes:
        served: services or actions are declared, so a relay reports what a change waits for.
        report: newest report of the relay.
        held_s: since when a change waits for a goal that must not be interrupted; None if none waits.
        kept: state is declared, so the data processes report what a change waits for.
        states: newest report of each side about the state that it lacks.
        lacked_s: since when a change waits for state before it begins; None if none waits.
    """

    served: bool = False
    report: RelayReported | None = None
    held_s: float | None = None
    kept: bool = False
    states: tuple[StateReported, ...] = ()
    lacked_s: float | None = None


@dataclass(frozen=True)
class Floor:
    """Least margin for the messages of an output (by index), valid until a time; seconds."""

    index: int
    margin_s: float
    until_s: float


@dataclass(frozen=True)
class Early:
    """Takeovers by silence (fast_takeover.py). Times on the robot's steady clock, seconds.

    Attributes:
        taken_s: time of the last takeover, until it is judged; then None.
        missing: (index, due time) of the outputs whose message was missing.
        mistakes_s: times of the latest takeovers that no limit confirmed.
        off: there were too many mistakes, so no takeover by silence happens.
        floors: margins learned from the mistakes.
    """

    taken_s: float | None = None
    missing: tuple[tuple[int, float], ...] = ()
    mistakes_s: tuple[float, ...] = ()
    off: bool = False
    floors: tuple[Floor, ...] = ()


@dataclass(frozen=True)
class Stalls:
    """Steps of our own that came late. Times on the robot's steady clock, seconds.

    Attributes:
        stepped_s: time of the last step; None before the first.
        until_s: silence is not judged before this time.
        last_s: end of the last stall; None if there was none.
        first_s: end of the first stall of the present row: stalls with less than HEALTHY_S between them.
        read_s: last Tick, when all that had arrived was read; silence is judged as of then. None before the first.
    """

    stepped_s: float | None = None
    until_s: float = 0.0
    last_s: float | None = None
    first_s: float = 0.0
    read_s: float | None = None


@dataclass(frozen=True)
class Robot:
    """State of the robot's control process. Times on its steady clock, seconds.

    Attributes:
        grant: what the cloud is allowed: epochs, the cloud addressed, the preparation; see the fence.
        started_us: start of this control process.
        settings, inputs: from the configuration.
        asked: settings to be applied as soon as that is safe (settling).
        link: health of the link to the cloud addressed.
        policy: state of the rule.
        phase, since_s: the present phase and when it began.
        charged_s: when the side in charge last changed.
        preparation: the side that gets ready; None while nobody does.
        failures, retry_s: called-off preparations in a row; no new one before retry_s.
        both_silent: the last preparation for need ended because the cloud's outputs were as silent as the robot's.
        situation: everything heard besides the link, see Situation.
        nodes_ready: the robot's CORE nodes are Active.
        outputs: from the configuration, in the collector's numbering.
        slow: state of the rated outputs (slow_outputs.py).
        shape: of the configuration (shape.py); "" if unknown.
        duplicated: the robot has duplicated nodes; without any there is nothing to change over.
        hot: its duplicated CORE nodes are Hot, so it can go on at once.
        early: see Early.
        robot_while: the outputs, by index, whose `while` is true on the robot.
        vetoes: of each source that has any.
        forbidden_s: since when a veto that hardens holds; None: none does.
        pin: on the robot.
        manual: the last switch by hand.
        leaving: the end that the cloud has announced.
        stalls: see Stalls.
        handing: see Handing.
        fell_at_s: when the robot became unable to act; None while able.
        decided, decided_s: the last decision given out, and when.
        levels, levels_s: what the levels last sent were made of, and when they were sent.
    """

    grant: Grant
    started_us: int
    settings: Settings
    inputs: tuple[InputSpec, ...] = ()
    link: Link = Link()
    policy: Policy = Policy()
    phase: Phase = Phase.ROBOT
    since_s: float = 0.0
    charged_s: float = 0.0
    preparation: Preparation | None = None
    failures: int = 0
    retry_s: float = 0.0
    both_silent: bool = False
    situation: Situation = Situation()
    nodes_ready: bool = False
    duplicated: bool = True
    hot: bool = False
    early: Early = Early()
    robot_while: tuple[int, ...] = ()
    outputs: tuple[OutputSpec, ...] = ()
    slow: tuple[SlowOutput, ...] = ()
    shape: str = ""
    vetoes: tuple[Vetoed, ...] = ()
    forbidden_s: float | None = None
    pin: Wish | None = None
    manual: Wish | None = None
    leaving: CloudLeaving | None = None
    asked: Settings | None = None
    stalls: Stalls = Stalls()
    handing: Handing = Handing()
    fell_at_s: float | None = None
    decided: Verdict = STARTING
    decided_s: float = 0.0
    levels: tuple[object, ...] = ()
    levels_s: float = -1.0

    @property
    def incarnation(self) -> str:
        """Return the incarnation of this control process."""
        return self.grant.robot

    @property
    def epoch(self) -> int:
        """Return the epoch of the side in charge."""
        return self.grant.epoch

    @property
    def last_epoch(self) -> int:
        """Return the highest epoch used, also by preparations."""
        return self.grant.last_epoch

    @property
    def candidate(self) -> int:
        """Return the epoch of the side that gets ready; 0 for none."""
        return self.grant.candidate

    @property
    def partner(self) -> str:
        """Return the incarnation of the cloud that is, or is to be, in charge."""
        return self.grant.cloud

    def slowest_output_s(self, *, prompt: bool = False) -> float:
        """Return the longest deadline of a rated output; with `prompt`, of one that is not slow. 0 without any."""
        bound_s = self.settings.activation_deadline_s
        judged = (o for o in self.outputs if o.rated and not (prompt and is_slow(o, bound_s)))
        return max((o.deadline_s for o in judged), default=0.0)

    def judged_s(self, now_s: float) -> float:
        """Return the time as of which silence is judged: the last Tick, or the newest beat taken since.

        Between two Ticks the message that ends a silence may still be unread, behind the present one.
        """
        if self.stalls.read_s is None:
            return now_s
        return max(self.stalls.read_s, self.link.heard_s or 0.0)


@dataclass(frozen=True)
class CloudBeat:
    """A beat of the cloud arrived at the pulse process.

    Attributes:
        beat: the beat.
        arrived_s: on this host's steady clock.
        wall_us: system clock minus steady clock here.
        sent: our own newest beat, reported with it; None if there was none.
    """

    beat: Beat
    arrived_s: float
    wall_us: int
    sent: PulseSent | None = None


@dataclass(frozen=True)
class GateReported:
    """The collector reported."""

    report: GateReport


@dataclass(frozen=True)
class NodesReported:
    """Level of the guardian, sent with each tick.

    Attributes:
        ready: the robot's duplicated CORE nodes are Active.
        duplicated: there are duplicated nodes.
        hot: the duplicated CORE nodes are Hot.
        asleep: rated outputs, by index, whose node is known and not Active.
    """

    ready: bool
    duplicated: bool = True
    hot: bool = False
    asleep: tuple[int, ...] = ()


@dataclass(frozen=True)
class WhileReported:
    """Level: the outputs, by index, whose `while` is true on the robot."""

    outputs: tuple[int, ...]


@dataclass(frozen=True)
class Veto:
    """A finding of another process that forbids the cloud or delays a change to it.

    Attributes:
        reason: its kind is LIMIT (ends a stay in the cloud at once), VETO (the robot takes over as if pinned; a veto
            that hardens becomes a LIMIT if the robot is not in charge by the activation deadline) or ATTEMPT (the
            policy does not begin a stay; pins and switches by hand wait for it, see readiness.py).
        message: for people.
        stops: the driver is to be stopped meanwhile (`strict`), whichever side acts.
        of_robot: it is about the robot's own replica: it does not forbid the cloud, and stops the driver only while
            the robot acts.
    """

    reason: Reason
    message: str
    stops: bool = False
    of_robot: bool = False


@dataclass(frozen=True)
class Vetoed:
    """Level of one source: all its present vetoes; an empty level withdraws its earlier ones."""

    source: str
    vetoes: tuple[Veto, ...] = ()


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
    CloudBeat | PulseSent | GateReported | DataReported | NodesReported | Vetoed | SwitchByHand | SetPin | CloudLeaving
    | SetSettings | RelayReported | StateReported | WhileReported | Tick
)  # fmt: skip


@dataclass(frozen=True)
class Permit:
    """Level, to the pulse process."""

    permission: Permission


@dataclass(frozen=True)
class Answer:
    """The answer to a switch by hand."""

    key: int
    accepted: bool
    message: str


Command = Permit | SetGate | Acting | Reopen | Decided | Answer
