"""The messages that the processes of one agent exchange. Each is a level: losing one loses nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words import beats, gates
from robot_offload_core.words.events import CloudData, DataReported, SetEgress, StateReported
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.reasons import Reason

ENVELOPE = b"e"
"""A `Carried` message of the cloud's replica on its way to the collector."""
OTHERS = b"o"
"""A `Carried` message of a shared topic that somebody outside the group said on the robot, on its way to the cloud."""
PASSED = b"p"
"""A `Carried` message that has passed at the collector, on its way to consumers in the cloud."""


@dataclass(frozen=True)
class Speak:
    """control -> pulse: what to say in this side's beats, said at `said_s`; renewed with every beat period."""

    incarnation: str
    body: beats.Permission | beats.CloudReport
    said_s: float


@dataclass(frozen=True)
class Arrived:
    """pulse -> control: a newer beat arrived; and our own newest beat, which saves control a wake-up."""

    text: str
    arrived_s: float
    wall_us: int
    sent: PulseSent | None


@dataclass(frozen=True)
class Heard:
    """pulse -> data: the newest beat of the partner, to refer to in envelopes."""

    incarnation: str
    sent_us: int
    arrived_s: float

    def echo_us(self, waited_s: float) -> int:
        """Return what an envelope refers to when its message waited so long before it was taken: an older beat."""
        return max(1, self.sent_us - round(waited_s * 1e6))


@dataclass(frozen=True)
class PulseStatus:
    """pulse -> control, once a second and at changes: the session and what was not understood.

    `cause` is the reason of what `message` says (the link's `LinkCause`); there may be one while it is connected.
    """

    connected: bool
    endpoint: str
    fallback: bool
    sessions: int
    message: str
    garbage: tuple[tuple[str, int], ...]
    realtime: str
    cause: str = ""


@dataclass(frozen=True)
class CloudTypes:
    """data -> collector, with every probe of the cloud: (output, interface type) of the cloud's replicas.

    A type is its name, and behind a blank its hash where the middleware of the cloud gives one.
    """

    types: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Orders:
    """control -> data (robot): identity for headers and probes, renewed with every beat period.

    `word` answers a switch by hand that was asked for in the cloud: `REQUEST|0 or 1|message`, "" for none. `preparing`:
    epoch under which the robot gets ready, 0 while it does not. `active`: nodes of this side that are Active.
    """

    incarnation: str
    epoch: int
    word: str = ""
    preparing: int = 0
    active: tuple[str, ...] = ()


@dataclass(frozen=True)
class Egress:
    """control -> data (cloud), renewed with every beat heard: what may leave.

    Attributes:
        incarnation: of our control process.
        robot: incarnation of the robot served; inputs of others are refused.
        egress: token and end of the lease; token None closes.
        nodes: (node, lifecycle state) here, for the robot's guardian.
        word: a switch by hand asked for here, `SITE:number`; "" for none.
        veils: what we say names the robot by the hash of its incarnation (veil.py).
    """

    incarnation: str
    robot: str
    egress: SetEgress
    nodes: tuple[tuple[str, str], ...] = ()
    word: str = ""
    veils: bool = True


@dataclass(frozen=True)
class DataStatus:
    """data -> control: the data session and its counters.

    Attributes:
        report: for the robot's machine; None in the cloud.
        cloud_data: for the cloud's machine; None on the robot.
        complete: the last values of all latched inputs are the robot's (cloud only).
        word: what the other side's control says (see Orders and Egress).
        replicas: (node, lifecycle state) of the other side.
        problems: (reason, message) for diagnostics.
        counters: (name, value) for diagnostics.
        flowing: rated outputs, by index, that a replica here has published within the deadline (cloud only).
        occasions: outputs, by index, whose `while.topic` has arrived within its time.
        states: what each side lacks of the state of the other (robot only).
    """

    report: DataReported | None
    cloud_data: CloudData | None
    complete: bool
    endpoint: str
    word: str = ""
    replicas: tuple[tuple[str, str], ...] = ()
    problems: tuple[tuple[str, str], ...] = ()
    counters: tuple[tuple[str, int], ...] = ()
    flowing: tuple[int, ...] = ()
    occasions: tuple[int, ...] = ()
    states: tuple[StateReported, ...] = ()


@dataclass(frozen=True)
class CollectorStatus:
    """collector -> control, at changes and five times a lease; once a second with all behind `report`.

    `ages_ms` are those of the newest message of the cloud, by output; `silence` is that of the last change of side.
    """

    report: gates.GateReport
    problems: tuple[tuple[str, str], ...] = ()
    counters: tuple[tuple[str, int], ...] = ()
    ages_ms: tuple[tuple[str, int], ...] = ()
    silence: tuple[Site, float, float] | None = None


@dataclass(frozen=True)
class Notes:
    """control <-> data, once a second and at changes: notes for the other side, and notes of the other side.

    `incarnation` is of the control process that wrote them.
    """

    incarnation: str
    text: str


@dataclass(frozen=True)
class Reported:
    """robot control -> data, once a second, and data -> cloud control: the robot's own numbers, opaque here."""

    text: str


@dataclass(frozen=True)
class Limits:
    """control -> collector and data, once a second and at changes: limits that can change at run time.

    `inputs` holds (input, oldest age in ms, most messages a second) of each input; `loss_timeout_s` and `activation_s`
    are those of `collectors.Collector`.
    """

    max_command_age_s: float
    gate_timeout_s: float
    inputs: tuple[tuple[str, float, float], ...]
    loss_timeout_s: float = 0.0
    activation_s: float = 0.0


@dataclass(frozen=True)
class Fatal:
    """any -> supervisor: the start must fail with this message and exit code."""

    process: str
    message: str
    exit_code: int = 4


@dataclass(frozen=True)
class Unheard:
    """collector -> supervisor, ten times a second while it lasts: nothing has come from a process for `silent_s`."""

    process: str
    silent_s: float


@dataclass(frozen=True)
class Alive:
    """any -> supervisor, twice a second: all threads work; the sign of the slowest one is `age_s` old."""

    process: str
    pid: int
    age_s: float


@dataclass(frozen=True)
class Lives:
    """supervisor -> control, once a second: (process, deaths, of these: because it hung, for a broken invariant)."""

    processes: tuple[tuple[str, int, int, int], ...]


@dataclass(frozen=True)
class Carried:
    """An output's message with its header; `kind` is ENVELOPE, PASSED or OTHERS. The payload is opaque here."""

    kind: bytes
    index: int
    header: bytes
    payload: Any


@dataclass(frozen=True)
class RelayOrders:
    """robot control -> robot relay, at changes and five times a lease: what the relay cannot see by itself.

    Attributes:
        robot, cloud: incarnations of the two control processes; cloud "" while none is heard.
        epoch: newest that control has named to the cloud.
        candidate: the side that gets ready and its token; None when no change is prepared.
        able: sides whose CORE nodes are Active.
        active: nodes of this side that are Active, by resource name.
        effects: the side whose calls at used names are admitted; None: nobody's, they wait.
        said_s: when control said so, on this host's steady clock.
    """

    robot: str
    cloud: str
    epoch: int
    candidate: tuple[Site, Token] | None
    able: tuple[Site, ...]
    active: tuple[str, ...]
    effects: Site | None
    said_s: float


@dataclass(frozen=True)
class RelayStatus:
    """relay -> control and collector of its side, at changes and every 100 ms.

    Attributes:
        candidate: token of the preparation that `pending` is about; None for none (and always in the cloud).
        pending: what the candidate still lacks, (reason, message); empty: as far as goals and requests go it is ready.
        hold: an action with a goal that a planned switch waits for, "" for none.
        hold_for_s: how long it waits for that goal.
        holder: who holds, as the relay last saw (in the cloud: CLOUD while it may act).
        busy: this side's nodes still have goals or requests to end: they are not to be deactivated yet.
        executing: actions that this side executes, by public name.
        unfit: a mirror here has ended long before its goal: this side must not take over by silence (robot only).
        lacking: what the side that acts has not got, (reason, message): it goes on without them, Degraded.
        problems, counters: for diagnostics, once a second; else empty.
    """

    candidate: Token | None
    pending: tuple[tuple[str, str], ...]
    hold: str
    busy: bool
    executing: tuple[str, ...]
    hold_for_s: float = 0.0
    holder: Site | None = None
    unfit: bool = False
    lacking: tuple[tuple[str, str], ...] = ()
    problems: tuple[tuple[str, str], ...] = ()
    counters: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class HolderChanged:
    """collector -> relay: the collector's memory names another holder. A wake-up; who, stands in the memory."""


@dataclass(frozen=True)
class Letters:
    """relay <-> data: a message of one side's relay to the other's; opaque to data, may be lost, large or late."""

    data: bytes


@dataclass(frozen=True)
class PulseSent:
    """The pulse process sent a beat; `granted` when it carried a grant."""

    sent_s: float
    granted: bool


@dataclass(frozen=True)
class SetGate:
    """Level, to the collector."""

    gate: Gate


@dataclass(frozen=True)
class Reopen:
    """To pulse and data: drop the sessions with everything buffered in them."""

    reason: Reason
