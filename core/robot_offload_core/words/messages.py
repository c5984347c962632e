"""The messages that the processes of one agent exchange. Each is a level, so a lost one does no harm."""

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
"""A `Carried` message of a shared topic from a node outside the group on the robot, on its way to the cloud."""
PASSED = b"p"
"""A `Carried` message that has passed at the collector, on its way to consumers in the cloud."""


@dataclass(frozen=True)
class Speak:
    """control -> pulse: control's part of this side's beats, sent at `said_s`; renewed every beat period."""

    incarnation: str
    body: beats.Permission | beats.CloudReport
    said_s: float


@dataclass(frozen=True)
class Arrived:
    """pulse -> control: a newer beat arrived. `sent` is our own newest beat, which saves control a wake-up."""

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
        """Return the echo reference of a message that waited `waited_s` before we took it: an older beat's time."""
        return max(1, self.sent_us - round(waited_s * 1e6))


@dataclass(frozen=True)
class PulseStatus:
    """pulse -> control, once a second and at changes: the session and what was not understood.

    `cause` is the reason behind `message` (the link's `LinkCause`); it may be set even while connected.
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

    A type is its name, followed by a blank and its hash if the cloud's middleware provides one.
    """

    types: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Orders:
    """control -> data (robot): identity for headers and probes, renewed every beat period.

    Attributes:
        incarnation, epoch: the robot's identity.
        word: answer to a switch by hand requested in the cloud: `REQUEST|0 or 1|message`; "" for none.
        preparing: epoch under which the robot gets ready; 0 while it does not.
        active: nodes of this side that are Active.
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
        word: a switch by hand requested here, `SITE:number`; "" for none.
        veils: our messages name the robot by the hash of its incarnation (veil.py).
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
        word: from the other side's control (see Orders and Egress).
        replicas: (node, lifecycle state) of the other side.
        problems: (reason, message) for diagnostics.
        counters: (name, value) for diagnostics.
        flowing: rated outputs, by index, that a replica here has published within the deadline (cloud only).
        occasions: outputs, by index, whose `while.topic` has arrived within its time.
        states: what each side lacks of the other side's state (robot only).
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
    """collector -> control, at changes and five times a lease; once a second with all fields after `report`.

    `ages_ms` holds the age of the cloud's newest message, by output; `silence` is that of the last change of side.
    """

    report: gates.GateReport
    problems: tuple[tuple[str, str], ...] = ()
    counters: tuple[tuple[str, int], ...] = ()
    ages_ms: tuple[tuple[str, int], ...] = ()
    silence: tuple[Site, float, float] | None = None


@dataclass(frozen=True)
class Notes:
    """control <-> data, once a second and at changes: notes to the other side, and notes from it.

    `incarnation` is that of the control process that wrote them.
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

    `inputs` holds (input, oldest age in ms, most messages a second) of each input. For `loss_timeout_s` and
    `activation_s` see `collectors.Collector`.
    """

    max_command_age_s: float
    gate_timeout_s: float
    inputs: tuple[tuple[str, float, float], ...]
    loss_timeout_s: float = 0.0
    activation_s: float = 0.0


@dataclass(frozen=True)
class Fatal:
    """any -> supervisor: the start must fail, with this message and exit code."""

    process: str
    message: str
    exit_code: int = 4


@dataclass(frozen=True)
class Unheard:
    """collector -> supervisor, ten times a second while true: a process has sent nothing for `silent_s`."""

    process: str
    silent_s: float


@dataclass(frozen=True)
class Alive:
    """any -> supervisor, twice a second: all threads work; the slowest one's sign of life is `age_s` old."""

    process: str
    pid: int
    age_s: float


@dataclass(frozen=True)
class Lives:
    """supervisor -> control, once a second: (process, all deaths, deaths by hanging, deaths by a broken invariant)."""

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
        effects: the side whose calls at used names are admitted; None: calls of both sides wait.
        said_s: when control sent it, on this host's steady clock.
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
        pending: what the candidate still lacks, (reason, message); empty if its goals and requests are ready.
        hold: an action with a goal that a planned switch waits for, "" for none.
        hold_for_s: how long the switch waits for that goal.
        holder: the holder as the relay last saw it (in the cloud: CLOUD while it may act).
        busy: this side's nodes still have goals or requests to end and must not be deactivated yet.
        executing: actions that this side executes, by public name.
        unfit: a mirror here has ended long before its goal; this side must not take over by silence (robot only).
        lacking: what the active side lacks, (reason, message): it goes on without, Degraded.
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
    """collector -> relay: wake-up, because the collector's memory names another holder."""


@dataclass(frozen=True)
class Letters:
    """relay <-> data: a message between the relays of the two sides; opaque to data; may be lost, large or late."""

    data: bytes


@dataclass(frozen=True)
class PulseSent:
    """The pulse process sent a beat; `granted` if it carried a grant."""

    sent_s: float
    granted: bool


@dataclass(frozen=True)
class SetGate:
    """Level to the collector: control's order."""

    gate: Gate


@dataclass(frozen=True)
class Reopen:
    """To pulse and data: drop the sessions with everything buffered in them."""

    reason: Reason
