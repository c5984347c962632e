"""The (state x event) pairs that a run has met.

A pair is (machine, state before the event, class of the event). The classes divide the events of the three machines by
what the protocol distinguishes, judged from the input alone, outside the machines' own branches. If a class has several
causes ("beat: not good"), each cause must also be met once in some state: the pairs with the state ANY. `expected` is
every pair except those of UNREACHABLE, each of which is listed with the reason why it cannot occur.
"""

from __future__ import annotations

from fnmatch import fnmatchcase

from robot_offload_core.collector.state import Collector
from robot_offload_core.control.cloud import lease
from robot_offload_core.control.robot import placement
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.beats import Beat, CloudReport, Permission
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import DataReported, Tick
from robot_offload_core.words.gates import Gate, Ruling
from robot_offload_core.words.messages import PulseSent

Pair = tuple[str, str, str]
ANY = "any"

STATES = {
    "robot": tuple(phase.value for phase in Phase),
    "cloud": ("Alone", "Asleep", "Waking", "Acting", "LeaseExpired", "DuplicateIdentity"),
    "collector": ("empty", "resumed", "robot", "robot, cloud next", "cloud", "cloud, robot next",
                  "fell back from robot", "fell back from cloud"),
}  # fmt: skip
EVENTS = {
    "robot": (
        "beat: good", "beat: not good", "beat: bare", "beat: other cloud", "sent: granted", "sent: plain", "gate: same",
        "gate: ahead", "gate: fell back", "gate: not ours", "data: fresh", "data: not fresh", "nodes: ready",
        "nodes: not ready", "by hand: robot", "by hand: cloud", "pin: robot", "pin: cloud", "pin: none", "tick",
        "tick: after a stall",
    ),
    "cloud": (
        "beat: other robot", "beat: nothing new", "beat: newer epoch, granted", "beat: newer epoch", "beat: no grant",
        "beat: grant", "nodes: ready", "nodes: not ready", "data", "tick", "tick: after a pause",
    ),
    "collector": (
        "robot message", "cloud message: current", "cloud message: next", "cloud message: foreign",
        "cloud message: stale", "cloud message: repeated", "effect: current", "effect: foreign", "gate: older control",
        "gate: new control", "gate: older epoch", "gate: same", "gate: same, armed", "gate: newer, robot",
        "gate: newer, cloud", "tick", "tick: control silent",
    ),
}  # fmt: skip
CAUSES = {
    "robot": (
        "beat: no echo of ours", "beat: not served", "beat: late echo", "beat: other epoch", "beat: not acting",
        "beat: first", "beat: other cloud, ours is live", "beat: other cloud, ours is silent", "gate: none",
        "gate: foreign", "gate: behind", "data: disconnected", "data: silent", "data: other cloud",
    ),
    "cloud": (
        "beat: bare", "beat: for another cloud", "beat: old", "beat: older epoch", "beat: grant without echo",
        "beat: grant from before a pause", "beat: dead grant", "beat: living grant",
    ),
    "collector": ("changed over to the cloud", "changed over to the robot", "not all ready", "before restart",
                  "foreign but fresh"),
}  # fmt: skip

UNREACHABLE: tuple[tuple[str, str, str, str], ...] = (
    ("robot", "Robot", "beat: good", "the epoch of a robot in charge is granted to nobody"),
    ("robot", "Takeover", "beat: good", "the epoch of a robot in charge is granted to nobody"),
    ("robot", "Robot", "gate: ahead", "every way into this phase names an epoch newer than any candidate"),
    ("robot", "Takeover", "gate: ahead", "every way into this phase names an epoch newer than any candidate"),
    ("robot", "Takeover", "nodes: not ready", "told on change only, and this phase means not ready"),
    ("robot", "Cloud", "gate: not ours", "the cloud is in charge only after the collector has reported this epoch"),
    ("robot", "ToRobot", "gate: not ours", "the cloud is in charge only after the collector has reported this epoch"),
    ("cloud", "Acting", "nodes: ready", "told on change only, and this state means ready"),
    ("cloud", "Waking", "nodes: not ready", "told on change only, and this state means not ready"),
    ("cloud", "Alone", "beat: n*", "no robot is served: every beat is another robot's"),
    ("cloud", "Alone", "beat: grant", "no robot is served: every beat is another robot's"),
    ("cloud", ANY, "beat: older epoch", "a pulse process gets its control's words in order, and so do its beats"),
    (
        "collector",
        "*",
        "gate: older control",
        "an earlier control is dead before the next starts, its words came first",
    ),
    (
        "collector",
        "*",
        "gate: newer, cloud",
        "the cloud is called current only after this collector changed over to it",
    ),
    ("collector", "empty", "gate: [!n]*", "without a charge every gate is a new control's"),
    ("collector", "empty", "gate: newer, robot", "without a charge every gate is a new control's"),
    ("collector", "empty", "cloud message: *", "nothing leaves the cloud before a control has spoken here and granted"),
    ("collector", "empty", "effect: *", "nothing leaves the cloud before a control has spoken here and granted"),
    ("collector", "empty", "tick: control silent", "nobody has spoken yet, that is no silence"),
    ("collector", "fell back *", "tick: control silent", "silence is noticed once"),
    ("collector", "*, * next", "gate: older epoch", "armed means that this epoch was heard from control"),
    ("collector", "resumed", "cloud message: repeated", "a restarted collector has passed nothing yet"),
    ("collector", "resumed", "cloud message: next", "nobody is next"),
    ("collector", "robot", "cloud message: next", "nobody is next"),
    ("collector", "cloud", "cloud message: next", "nobody is next"),
    ("collector", "fell back *", "cloud message: next", "nobody is next"),
    ("collector", "cloud, robot next", "cloud message: next", "the robot is next, its messages carry no token"),
    ("collector", "robot", "cloud message: [!f]*", "the robot's token is in no envelope"),
    ("collector", "fell back from robot", "cloud message: [!f]*", "the robot's token is in no envelope"),
    ("collector", "robot, cloud next", "cloud message: current", "the robot's token is in no envelope"),
    ("collector", "robot*", "effect: current", "the robot's token is in no request"),
    ("collector", "fell back from robot", "effect: current", "the robot's token is in no request"),
)
"""(machine, state, event, why it cannot occur); `*` matches anything, `[!x]` any letter but x."""


class Coverage:
    """Collects pairs.

    Attributes:
        pairs: how often each pair was met.
    """

    def __init__(self) -> None:
        self.pairs: dict[Pair, int] = {}

    def met(self, machine: str, state: str, event: str, cause: str = "") -> None:
        """Count one more of this pair; `cause` is the event's cause within its class."""
        pairs = self.pairs
        pair = (machine, state, event)
        pairs[pair] = pairs.get(pair, 0) + 1
        if cause:
            pair = (machine, ANY, cause)
            pairs[pair] = pairs.get(pair, 0) + 1

    def robot(self, robot: placement.Robot, event: placement.Event, now_s: float) -> None:
        """Note that the placement machine is about to take `event`."""
        self.met("robot", robot.phase.value, *_robot_event(robot, event, now_s))
        if isinstance(event, placement.CloudBeat) and event.sent is not None:
            self.met("robot", robot.phase.value, *_robot_event(robot, event.sent, now_s))

    def cloud(self, cloud: lease.Cloud, event: lease.Event, now_s: float) -> None:
        """Note that the lease machine is about to take `event`."""
        self.met("cloud", cloud_state(cloud), *_cloud_event(cloud, event, now_s))

    def collector(self, collector: Collector, event: str, cause: str = "") -> None:
        """Note that the collector in this state is about to take `event`."""
        self.met("collector", collector_state(collector), event, cause)

    def cloud_message(self, collector: Collector, index: int, envelope: Envelope, now_s: float) -> None:
        """Note that the collector is about to be offered a message of the cloud."""
        self.collector(collector, *_cloud_message(collector, index, envelope, now_s))

    def effect(self, collector: Collector, token: Token) -> None:
        """Note that the collector is about to be asked for an effect."""
        current = collector.charge is not None and collector.charge.token == token
        self.collector(collector, "effect: current" if current else "effect: foreign")

    def gate(self, collector: Collector, gate: Gate) -> None:
        """Note that the collector is about to take a gate."""
        self.collector(collector, "gate: " + _gate_event(collector, gate))

    def passage(self, site: Site, reason: Ruling) -> None:
        """Count the outcome of an offer, if that is a cause of its own."""
        cause = {Ruling.CHANGED_OVER: f"changed over to the {site.value}", Ruling.NOT_ALL_READY: "not all ready",
                 Ruling.BEFORE_RESTART: "before restart"}.get(reason)  # fmt: skip
        if cause:
            pair = ("collector", ANY, cause)
            self.pairs[pair] = self.pairs.get(pair, 0) + 1


# -- states -----------------------------------------------------------------------------------------------------------


def cloud_state(cloud: lease.Cloud) -> str:
    """Return the cloud's state as it reports it; alone when it receives no robot."""
    return "Alone" if not cloud.robot and cloud.reported is lease.Stand.ASLEEP else cloud.reported.value


def collector_state(collector: Collector) -> str:
    """Return which side passes, and which may follow."""
    charge = collector.charge
    if charge is None:
        return "empty"
    if collector.fell_back:
        return "fell back from robot" if charge.site is Site.ROBOT else "fell back from cloud"
    if collector.gate_s is None:
        return "resumed"
    if collector.next is None:
        return "robot" if charge.site is Site.ROBOT else "cloud"
    return "robot, cloud next" if charge.site is Site.ROBOT else "cloud, robot next"


# -- events: (class, cause) -------------------------------------------------------------------------------------------


def _robot_event(robot: placement.Robot, event: placement.Event, now_s: float) -> tuple[str, str]:
    if isinstance(event, Tick):
        stepped_s = robot.stalls.stepped_s
        late = stepped_s is not None and now_s - stepped_s > robot.settings.stall_s
        return "tick: after a stall" if late else "tick", ""
    if isinstance(event, placement.CloudBeat):
        return _cloud_beat(robot, event.beat, event.arrived_s)
    if isinstance(event, PulseSent):
        return "sent: granted" if event.granted else "sent: plain", ""
    if isinstance(event, placement.GateReported):
        return _gate_report(robot, event)
    if isinstance(event, DataReported):
        return _data_report(robot, event)
    if isinstance(event, placement.NodesReported):
        return "nodes: ready" if event.ready else "nodes: not ready", ""
    return _person(event)


def _person(event: placement.Event) -> tuple[str, str]:
    """Return what people, the cloud's operator and other publishers do."""
    if isinstance(event, placement.SwitchByHand):
        return "by hand: robot" if event.site is Site.ROBOT else "by hand: cloud", ""
    if isinstance(event, placement.SetSettings):
        return "settings", ""
    if isinstance(event, placement.CloudLeaving):
        return "leaving", ""
    if isinstance(event, placement.Vetoed):
        return "veto", ""
    if not isinstance(event, placement.SetPin):
        raise TypeError(f"the simulation does not bring about {type(event).__name__}")
    return "pin: none" if event.pin is None else f"pin: {event.pin.site.value}", ""


def _cloud_beat(robot: placement.Robot, beat: Beat, arrived_s: float) -> tuple[str, str]:
    link, report, echo = robot.link, beat.body, beat.echo
    if not link.peer:
        return "beat: other cloud", "beat: first"
    if beat.incarnation != link.peer:
        live = link.heard_s is not None and arrived_s - link.heard_s <= robot.settings.loss_timeout_s
        return "beat: other cloud", "beat: other cloud, ours is live" if live else "beat: other cloud, ours is silent"
    if not isinstance(report, CloudReport):
        return "beat: bare", ""
    if echo is None or echo.incarnation != robot.incarnation:
        return "beat: not good", "beat: no echo of ours"
    if report.serves != robot.incarnation:
        return "beat: not good", "beat: not served"
    if arrived_s - echo.sent_us / 1e6 > robot.settings.echo_limit_s:
        return "beat: not good", "beat: late echo"
    if report.epoch != (robot.candidate if robot.phase is Phase.TO_CLOUD else robot.epoch):
        return "beat: not good", "beat: other epoch"
    return ("beat: good", "") if report.acting else ("beat: not good", "beat: not acting")


def _gate_report(robot: placement.Robot, event: placement.GateReported) -> tuple[str, str]:
    charge = event.report.charge
    if charge is None:
        return "gate: not ours", "gate: none"
    if charge.token.robot != robot.incarnation:
        return "gate: not ours", "gate: foreign"
    if charge.token.epoch < robot.epoch:
        return "gate: not ours", "gate: behind"
    if charge.token.epoch > robot.epoch:
        return "gate: ahead", ""
    return "gate: fell back" if event.report.fell_back else "gate: same", ""


def _data_report(robot: placement.Robot, event: DataReported) -> tuple[str, str]:
    if not event.connected:
        return "data: not fresh", "data: disconnected"
    if event.age_s is None or event.age_s > 0.5:
        return "data: not fresh", "data: silent"
    return ("data: fresh", "") if event.cloud == robot.link.peer else ("data: not fresh", "data: other cloud")


def _cloud_event(cloud: lease.Cloud, event: lease.Event, now_s: float) -> tuple[str, str]:
    if isinstance(event, Tick):
        late = cloud.stepped_s is not None and now_s - cloud.stepped_s > cloud.settings.pause_s
        return "tick: after a pause" if late else "tick", ""
    if isinstance(event, lease.RobotBeat):
        return _robot_beat(cloud, event.beat, now_s)
    if isinstance(event, lease.CloudNodes):
        return "nodes: ready" if event.ready else "nodes: not ready", ""
    return "data", ""


def _robot_beat(cloud: lease.Cloud, beat: Beat, now_s: float) -> tuple[str, str]:  # noqa: C901, PLR0911 - a flat table
    permission, echo = beat.body, beat.echo
    if beat.incarnation != cloud.robot:
        return "beat: other robot", ""
    if beat.sent_us <= cloud.robot_sent_us:
        return "beat: nothing new", "beat: old"
    if not isinstance(permission, Permission):
        return "beat: nothing new", "beat: bare"
    if permission.cloud != cloud.incarnation:
        return "beat: nothing new", "beat: for another cloud"
    if permission.epoch < cloud.epoch:
        return "beat: nothing new", "beat: older epoch"
    if permission.epoch > cloud.epoch:
        return "beat: newer epoch, granted" if permission.granted else "beat: newer epoch", ""
    if not permission.granted:
        return "beat: no grant", ""
    if echo is None or echo.incarnation != cloud.incarnation:
        return "beat: grant", "beat: grant without echo"
    if echo.sent_us / 1e6 < cloud.lease.void_before_s:
        return "beat: grant", "beat: grant from before a pause"
    if echo.sent_us / 1e6 + cloud.settings.lease_s <= now_s:
        return "beat: grant", "beat: dead grant"
    return "beat: grant", "beat: living grant"


def _cloud_message(collector: Collector, index: int, envelope: Envelope, now_s: float) -> tuple[str, str]:
    fresh = envelope.age_s(now_s) <= collector.max_age_s
    charge, following, held = collector.charge, collector.next, collector.fence.held[index]
    if charge is not None and envelope.token == charge.token:
        known, last = "current", collector.fence.passed[index]
    elif following is not None and envelope.token == following.token:
        known, last = "next", -1 if held is None else held.sequence
    else:
        return "cloud message: foreign", "foreign but fresh" if fresh else ""
    if not fresh:
        return "cloud message: stale", ""
    return "cloud message: repeated" if envelope.sequence <= last else f"cloud message: {known}", ""


def _gate_event(collector: Collector, gate: Gate) -> str:
    charge, current = collector.charge, gate.current
    if gate.started_us < collector.started_us:
        return "older control"
    if charge is None or gate.started_us > collector.started_us:
        return "new control"
    if current.token.epoch == charge.token.epoch:
        return "same" if gate.next is None else "same, armed"
    if current.token.epoch < charge.token.epoch:
        return "older epoch"
    return "newer, robot" if current.site is Site.ROBOT else "newer, cloud"


# -- what is to be met ------------------------------------------------------------------------------------------------


def expected() -> set[Pair]:
    """Return every pair that can occur."""
    product = {
        (machine, state, event) for machine, states in STATES.items() for state in states for event in EVENTS[machine]
    }
    product |= {(machine, ANY, cause) for machine, causes in CAUSES.items() for cause in causes}
    return {pair for pair in product if unreachable(pair) is None}


def unreachable(pair: Pair) -> str | None:
    """Return why this pair cannot occur; None when it can."""
    for machine, state, event, reason in UNREACHABLE:
        if pair[0] == machine and fnmatchcase(pair[1], state) and fnmatchcase(pair[2], event):
            return reason
    return None
