"""What the data processes of both sides share: probes out and in, notes passed on, reports.

Several threads may call: those of the link (`arrived`), of ROS (messages of the user's nodes) and of the bus (the
rest). Levels are read once per call. State that two threads change is guarded by the shell's lock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Protocol

from robot_offload_core.data import probe
from robot_offload_core.data.probe import Probe, ProbeError, Sign
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope, EnvelopeError
from robot_offload_core.topics.pauses import Pauses
from robot_offload_core.topics.waits import Waits
from robot_offload_core.words.declared import MEBIBYTE, Priority
from robot_offload_core.words.messages import Heard, Letters, Limits, Notes, Reopen, Reported
from robot_offload_core.words.settings import OutputSpec

STATUS_PERIOD_S = 0.040
"""How often control gets a report."""
SIGN_S = 0.050
"""Longest time between two signs of life: far below `pauses.LIMIT_S`."""
EARLY_PROBE_S = 0.030
"""A probe due within this time goes out with a report: a wake-up costs more than the probe."""
DETAIL_PERIOD_S = 1.0
"""How often a report includes problems and counters."""
RELAY = "relay"
"""Channel of the messages between the two relays."""
REPORT = "report"
"""Channel of the robot's own figures."""
MAX_REPORT = 2000
"""Bytes of a report; there is one a second."""


class DataPorts(Protocol):
    """What the shell does for a data process."""

    @property
    def lock(self) -> AbstractContextManager[Any]:
        """Return the lock that guards state changed by several threads."""

    def now_s(self) -> float:
        """Return the steady clock, seconds."""

    def system_s(self) -> float:
        """Return the system clock, seconds."""

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent."""

    def renew(self, to: str, message: object) -> bool:
        """Send a level that has not changed: it is read when its receiver wakes for another reason."""

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        """Send an output's message with its header to another process of this agent."""

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        """Send over the link; return False when the message was certainly not sent."""

    def link_status(self) -> tuple[bool, str]:
        """Return whether the data session is connected, and its endpoint."""

    def reopen(self, reason: str) -> None:
        """Drop the data session and open a new one."""

    def types(self) -> dict[str, str]:
        """Return the interface types found in this side's graph, by input or output."""

    def warn(self, message: str) -> None:
        """Log a warning."""


@dataclass(frozen=True)
class InputPlan:
    """An input as the data processes need it.

    Attributes:
        name: of the input.
        max_age_ms: oldest message that the replicas get; 0: any, and the input is not required.
        rate_hz: most messages a second to the cloud; 0: all.
        latched: last values are kept and exchanged.
        min_rate_hz: on a narrow link the input is thinned, but never below this rate; 0: it is never thinned.
        priority: which inputs go first then.
        latest: the newest refused message is sent as soon as there is room.
        topic: the name that people know; "": `name`.
    """

    name: str
    max_age_ms: float = 0.0
    rate_hz: float = 0.0
    latched: bool = False
    min_rate_hz: float = 0.0
    priority: Priority = Priority.NORMAL
    latest: bool = False
    topic: str = ""


@dataclass(frozen=True)
class OutputPlan:
    """An output as the data processes need it.

    Attributes:
        name: of the output.
        deadline_s: silence of a rated output that means a fault; 0: not rated.
        mirrored: it has consumers in the cloud.
        of_cloud: its node has placement Cloud: it leaves under the presence token, whichever side is in charge.
        spec: as the collector knows it; None if only the fields above matter.
    """

    name: str
    deadline_s: float = 0.0
    mirrored: bool = False
    of_cloud: bool = False
    spec: OutputSpec | None = None

    @property
    def rated(self) -> bool:
        """Return whether silence of the output is judged."""
        return self.deadline_s > 0


@dataclass(frozen=True)
class DataPlan:
    """Configuration of the data processes.

    Attributes:
        inputs, outputs: the declared ones.
        max_message_size: bytes; a larger message does not cross.
        carried: the agents carry inputs and mirrored outputs (Zenoh).
    """

    inputs: tuple[InputPlan, ...]
    outputs: tuple[OutputPlan, ...]
    carried: bool = True
    max_message_size: int = 8 * MEBIBYTE


def others_of(name: str) -> str:
    """Return the channel of the messages that others publish on a shared output."""
    return f"others/{name}"


class DataProcess(ABC):
    """Base class of the data processes of both sides.

    Attributes:
        heard: the newest beat of the partner, for echo references.
        probe: the newest whole probe of the other side.
        probe_s: when the other side was last heard.
        acknowledged: digest of our newest whole probe that the other side has received.
        whole_due_s: when to send a whole probe again.
        latched: last values of each latched input on this side, and of others' messages on latched shared outputs.
        shared: channels of the latter.
        notes: of our control, for the other side.
        lacks: why this side does not know a state of the active side, by name of the state.
        before_active: names of the states that a node takes when it becomes Active.
        came_s: when a message of each input last came.
        problems: by key, for diagnostics.
        counters: by name.
    """

    def __init__(self, plan: DataPlan, ports: DataPorts) -> None:
        self.plan = plan
        self.ports = ports
        self.pauses = Pauses(ports.now_s())
        self.heard: Heard | None = None
        self.probe: Probe | None = None
        self.probe_s: float | None = None
        self.acknowledged = ""
        self.whole_due_s = 0.0
        specs = [output.spec for output in plan.outputs if output.spec is not None]
        self.shared = {others_of(spec.name) for spec in specs if spec.shared and spec.latched}
        self.latched: dict[str, list[Any]] = {name: [] for name in self.shared}
        self.latched |= {i.name: [] for i in plan.inputs if i.latched}
        self._digests: dict[str, tuple[list[Any], str]] = {}
        self.notes = ""
        self.notes_passed: tuple[str, str] = ("", "")
        self.notes_due_s = 0.0
        self.counters: Counter[str] = Counter()
        self.lacks: dict[str, str] = {}
        self.before_active: frozenset[str] = frozenset()
        self.problems: dict[str, tuple[str, str]] = {}
        self.came_s: dict[str, float] = {}
        self.status_due_s = self.probe_due_s = self.detail_due_s = ports.now_s()

    # -- the bus ------------------------------------------------------------------------------------------------------

    def handle(self, message: object) -> None:
        """Take one datagram of another process."""
        if isinstance(message, Heard):
            self.heard = message
        elif isinstance(message, Reopen):
            self.ports.reopen(message.reason)
        elif isinstance(message, Notes):
            self.notes = message.text
        elif isinstance(message, Reported):
            self.ports.cross(REPORT, b"-", message.text.encode())
        elif isinstance(message, Limits):
            self.limit(message)
        elif isinstance(message, Letters):
            sent = self.ports.cross(RELAY, b"-", message.data)
            self.counters[f"relay.{'sent' if sent else 'unsent'}"] += 1
        else:
            self.order(message)

    def woke(self) -> None:
        """Record a sign of life of this process; a long gap between two is a pause."""
        self.pauses.waited(self.ports.now_s())

    @property
    def due_s(self) -> float:
        """Return when `turn` is due, or a sign of life, without which a wait would look like a pause."""
        return min(self.status_due_s, self.probe_due_s, self.pauses.alive_s + SIGN_S)

    def turn(self) -> None:
        """Send the probe and the report if they are due."""
        now_s = self.ports.now_s()
        soon_s = EARLY_PROBE_S if now_s >= self.status_due_s else 0.0
        if now_s >= self.probe_due_s - soon_s:
            self.probe_due_s = now_s + probe.PROBE_PERIOD_S
            self._send_probe(now_s)
        if now_s >= self.status_due_s:
            self.status_due_s = self.next_status_s(now_s)
            detailed = now_s >= self.detail_due_s
            self.detail_due_s = now_s + DETAIL_PERIOD_S if detailed else self.detail_due_s
            self.report(now_s, detailed)

    def waited_s(self, waits: Waits, published_s: float | None) -> float:
        """Return how long a message of a node here waited for us; `published_s`: its publisher's stamp."""
        if published_s is None:
            return 0.0
        return waits.waited_s(published_s, self.ports.system_s(), self.ports.now_s())

    def next_status_s(self, now_s: float) -> float:
        """Return when to send the next report, after one at `now_s`."""
        return now_s + STATUS_PERIOD_S

    def _send_probe(self, now_s: float) -> None:
        """Send a sign of life, or a whole probe if the other side lacks our newest one, and once a second."""
        held = self.probe.digest if self.probe else ""
        made = probe.signed(replace(self.make_probe(), notes=self.notes), held)
        sent: Probe | Sign = Sign(made.incarnation, made.digest, held)
        if made.digest != self.acknowledged or now_s >= self.whole_due_s:
            sent, self.whole_due_s = made, now_s + DETAIL_PERIOD_S
        self.ports.cross("probe", b"-", probe.encode(sent))

    def lack(self, lacks: dict[str, str]) -> None:
        """Take what this side lacks of the other side's state, by name; report a change at once."""
        if lacks != self.lacks:
            self.lacks = lacks
            self.probe_due_s = self.status_due_s = self.ports.now_s()

    def fits(self, name: str, payload: Any) -> bool:
        """Return whether a message is small enough to cross; count and report a larger one by name."""
        key, most = f"size {name}", self.plan.max_message_size
        if len(payload) <= most:
            if key in self.problems:
                self.note(key, None)
            return True
        self.counters[f"{name}.too_large"] += 1
        message = f"{name}: a message of {len(payload)} bytes is not carried, maxMessageSize is {most} bytes"
        self.note(key, ("MessageTooLarge", message))
        return False

    def note(self, key: str, problem: tuple[str, str] | None) -> None:
        """Keep or clear a problem for diagnostics."""
        if problem is None:
            self.problems.pop(key, None)
        else:
            self.problems[key] = problem

    def details(self, detailed: bool) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, int], ...]]:
        """Return problems and counters for a detailed report, otherwise empty tuples."""
        if not detailed:
            return (), ()
        return tuple(self.problems.values()), tuple(sorted(self.counters.items()))

    # -- the link -----------------------------------------------------------------------------------------------------

    def arrived(self, channel: str, header: bytes, payload: Any) -> None:
        """Take a message of the other side."""
        if channel == "probe":
            self._probe_arrived(payload)
            return
        if channel == RELAY:
            self.ports.send("relay", Letters(bytes(payload)))
            return
        if channel == REPORT:
            self.reported(payload)
            return
        kind, _, name = channel.partition("/")
        try:
            opened = self.opened(header)
        except EnvelopeError:
            self.counters["garbage.envelope"] += 1
            return
        self.carried_in(kind, name, opened, header, payload)

    def sealed(self, header: Envelope) -> bytes:
        """Encode a header of ours."""
        return envelope.encode(header)

    def opened(self, header: bytes) -> Envelope:
        """Decode a header of the other side; raise EnvelopeError if it is not valid."""
        return envelope.decode(header)

    def _probe_arrived(self, payload: bytes) -> None:
        try:
            received = probe.decode(payload)
        except ProbeError as error:
            self._refuse(error)
            return
        if not self.knows(received.incarnation):
            self.counters["probe.foreign"] += 1
            return
        self.note("version", None)
        self.acknowledged = received.held
        whole = received if isinstance(received, Probe) else self.probe
        if whole is None or whole.incarnation != received.incarnation:
            self.counters["probe.unknown"] += 1  # what it holds is on its way
            return
        with self.ports.lock:
            self.probe, self.probe_s = whole, self.ports.now_s()
        self.probed(whole)
        self._pass_notes(whole)

    def reported(self, payload: Any) -> None:
        """Count a report of the other side as garbage; only the cloud expects one."""
        del payload
        self.counters["garbage.report"] += 1

    def _refuse(self, error: ProbeError) -> None:
        """Count an invalid probe; record another version as a problem that a person has to solve."""
        self.counters["garbage.probe"] += 1
        if error.reason == "OtherVersion":
            message = f"The other side's agent is of another release ({error}); install the same one on both sides"
            self.note("version", ("OtherVersion", message))
        if self.counters["garbage.probe"] == 1:
            self.ports.warn(f"Ignoring a foreign probe ({error}); more of them are only counted")

    def _pass_notes(self, received: Probe) -> None:
        """Pass notes of the other side's control to ours: at changes, and once a second as ours may have restarted."""
        notes, now_s = (received.incarnation, received.notes), self.ports.now_s()
        if received.notes and (notes != self.notes_passed or now_s >= self.notes_due_s):
            self.notes_passed, self.notes_due_s = notes, now_s + DETAIL_PERIOD_S
            self.ports.send("control", Notes(*notes))

    def occasions(self, now_s: float) -> tuple[int, ...]:
        """Return the outputs, by index, whose `while.topic` has arrived within its time."""
        names = {i.topic or i.name: i.name for i in self.plan.inputs}
        found = []
        for index, output in enumerate(self.plan.outputs):
            condition = output.spec.while_ if output.spec is not None else None
            if condition is not None and condition.topic:
                came_s = self.came_s.get(names.get(condition.topic, ""))
                if came_s is not None and now_s - came_s <= condition.within_s:
                    found.append(index)
        return tuple(found)

    def probe_age_s(self, now_s: float) -> float | None:
        """Return the seconds since the other side was last heard on the data session; None: never."""
        return None if self.probe_s is None else now_s - self.probe_s

    def digests(self) -> dict[str, str]:
        """Return the hash of the values held of each latched input."""
        return {name: self.digest(name) for name, values in self.latched.items() if values}

    def digest(self, name: str) -> str:
        """Return the hash of the values held of one latched input.

        A list of values is never modified but replaced, so each is hashed once, however large it is.
        """
        values = self.latched[name]
        known = self._digests.get(name)
        if known is None or known[0] is not values:
            known = self._digests[name] = values, probe.digest(values)
        return known[1]

    # -- what each side does in its own way ---------------------------------------------------------------------------

    @abstractmethod
    def order(self, message: object) -> None:
        """Take a message of control or of the collector."""

    @abstractmethod
    def limit(self, limits: Limits) -> None:
        """Take limits that control has changed."""

    @abstractmethod
    def make_probe(self) -> Probe:
        """Return this side's next whole probe."""

    @abstractmethod
    def knows(self, incarnation: str) -> bool:
        """Return whether a probe from that incarnation of the other side is for us."""

    @abstractmethod
    def probed(self, received: Probe) -> None:
        """Take a probe of the other side."""

    @abstractmethod
    def carried_in(self, kind: str, name: str, opened: Envelope, header: bytes, payload: Any) -> None:
        """Take a message of the other side that arrived on channel kind/name."""

    @abstractmethod
    def report(self, now_s: float, detailed: bool) -> None:
        """Report to control."""
