"""Copy nodes' state (snapshots, topics, parameters) from the holder to the standby, all the time.

Each side hears its own node. The holder sends the node's state at once and again every second, because a standby may
come late. The receiving side gives state to its node only while the other side holds: a snapshot at once, the message
of a topic each time the node has become Active and listens, parameters at once and again each time the node has become
Active, because nodes install their callbacks then. Control is informed of missing state (`lack`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from robot_offload_core.data import parameter_values
from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.process import DataProcess
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.fence import lease
from robot_offload_core.fence.envelope import Envelope, EnvelopeError
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.topics import snapshots
from robot_offload_core.topics.snapshots import Refused, Standing
from robot_offload_core.topics.waits import Waits
from robot_offload_core.words.declared import ParameterState, SnapshotState, StateSpec, TopicState
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.lifecycle import State

CHANNEL = "state/"
SNAPSHOT_RESEND_S = 1.0
"""How often a snapshot is sent again until the other side has it."""
READ_S = 2.0
"""How long a snapshot waits for the node to read it: a node may listen only when it is Active."""


class StatePorts(Protocol):
    """What the shell does for the exchange of state."""

    def restore(self, name: str, payload: bytes) -> bool:
        """Give a state to this side's node; return whether the node has it.

        A snapshot is kept until the node takes it; a topic's message is given if the node listens.
        """

    def has(self, name: str) -> bool:
        """Return, without waiting, whether the newest snapshot that was given has reached this side's node."""

    def set_parameters(self, name: str, payload: bytes, active: bool) -> str | None:
        """Set parameters at the nodes here, once for each `payload` and `active` (declaring node is Active).

        Returns:
            A sentence about the parameters not taken, "" if all were; None while that is unknown.
        """

    def holder(self) -> Holding:
        """Return the side that holds, from the collector's memory (robot only)."""


@dataclass
class _Kept:
    """The newest message of a topic, or newest parameters, of the acting side's node.

    Attributes:
        payload: the message.
        given: whether it was given during the present activation of the node here.
        refused: which parameters the node here did not take; "" for none.
    """

    payload: bytes
    given: bool = False
    refused: str = ""


@dataclass
class _Reading:
    """How far the node here is with reading the snapshots given to it.

    Attributes:
        given: newest snapshot that was published for the node.
        had: newest snapshot that is known to have reached it.
        waits_s: since when the node has no fresh snapshot although one was published; None: it has.
    """

    given: Standing = field(default_factory=Standing)
    had: Standing = field(default_factory=Standing)
    waits_s: float | None = None


@dataclass
class _Said:
    """The newest state that the node here published, with the stay and the echo reference of that moment.

    The reference is a time stamp of the partner heard then; it means nothing to another partner.
    """

    stay: object
    payload: bytes
    partner: str
    echo_us: int
    due_s: float


class StateProcess(ABC):
    """Base class of both sides; the data process provides clock, link, lock, counters and problems.

    Attributes:
        sequence: of the last message sent; grows over restarts of this process.
        said: newest state of the node here, by name of the entry.
        standing: newest state received for the node here, by name of the entry.
        readings: how far the node has read its snapshots, by name of the entry.
        kept: received topic messages and parameters that the node here has not replaced by its own.
        stood_by: whether this side stood by at the last turn.
    """

    def __init__(self, states: Mapping[str, StateSpec], ports: StatePorts, data: DataProcess) -> None:
        self.states = states
        self.ports = ports
        self.data = data
        self.sequence = round(data.ports.now_s() * 1e6)
        self.said: dict[str, _Said] = {}
        self.standing = {name: Standing() for name in states}
        self.readings = {name: _Reading() for name, state in states.items() if isinstance(state, SnapshotState)}
        self.waits = {name: Waits() for name in self.readings}
        self.kept: dict[str, _Kept] = {}
        self.stood_by = False
        data.before_active = frozenset(name for name, state in states.items() if isinstance(state, SnapshotState))
        self._say_lacks(data.ports.now_s())

    def published(self, name: str, payload: bytes, published_s: float | None = None) -> None:
        """Take state that the node here published; an incomplete snapshot is dropped.

        Args:
            name: of the entry.
            payload: the state.
            published_s: its publisher's stamp, by the system clock of that host; None: it has none.
        """
        waited_s = self._waited_s(name, published_s)
        stay = self.stay()
        if stay is None or not self._whole(name, payload) or not self.data.fits(f"state {name}", payload):
            return
        if isinstance(self.states[name], ParameterState):
            said = self.said.get(name)
            if name in self.kept and not self.kept[name].given:
                return  # those of the other side come first
            if said is not None and (said.stay, said.payload) == (stay, payload):
                return
        if name in self.kept and self.kept[name].given:
            del self.kept[name]
            self.data.note(f"set {name}", None)
        heard = self.data.heard
        partner, echo_us = (heard.incarnation, heard.echo_us(waited_s)) if heard else ("", 0)
        self.said[name] = _Said(stay, payload, partner, echo_us, self.data.ports.now_s() + SNAPSHOT_RESEND_S)
        self._send(name)

    def _waited_s(self, name: str, published_s: float | None) -> float:
        """Return the longest time a snapshot may have waited for us, so that it does not look fresher than it is."""
        if name not in self.readings:
            return 0.0
        waited_s = self.data.waited_s(self.waits[name], published_s)
        return max(waited_s, self.data.pauses.at_most_s(self.data.ports.now_s()))

    def turn(self) -> None:
        """Resend state that is due, give nodes the state that they can take now, and report what a standby lacks."""
        now_s = self.data.ports.now_s()
        for name, said in list(self.said.items()):
            if now_s >= said.due_s:
                said.due_s = now_s + SNAPSHOT_RESEND_S
                self._send(name)
        active = self.active()
        for name, kept in list(self.kept.items()):
            self._give(name, kept, self.states[name].node in active)
        for name in self.states:
            self._judge_age(name, now_s)
        for name in self.readings:
            self._read(name, now_s)
        stands_by = self.stands_by()
        if self.stood_by and not stands_by:
            self._note_ages(now_s)
        self.stood_by = stands_by
        self._say_lacks(now_s)

    def _give(self, name: str, kept: _Kept, active: bool) -> None:
        """Give a topic's message to an Active node, or parameters to a node in any state."""
        if not isinstance(self.states[name], ParameterState):
            kept.given = active and (kept.given or self.ports.restore(name, kept.payload))
            return
        refused = self.ports.set_parameters(name, kept.payload, active)
        kept.given, kept.refused = active and refused is not None, refused or ""
        said = f"Parameters of the acting side: {kept.refused}"
        self.data.note(f"set {name}", ("ParameterRefused", said) if kept.refused else None)

    def _read(self, name: str, now_s: float) -> None:
        """Record which snapshot has reached the node here, or since when it has had no fresh one."""
        reading, state = self.readings[name], self.states[name]
        assert isinstance(state, SnapshotState)
        given = reading.given
        if given.taken_s is not None and given is not reading.had and self.ports.has(name):
            reading.had = given
        waits = given.taken_s is not None and reading.had.aged_s(now_s) > state.max_age_s and self.stands_by()
        reading.waits_s = None if not waits else now_s if reading.waits_s is None else reading.waits_s

    def _note_ages(self, now_s: float) -> None:
        """Record the age of the state with which this side continued at a change."""
        for name, standing in self.standing.items():
            aged_s = standing.aged_s(now_s)
            if aged_s != float("inf"):
                self.data.counters[f"state {name}.age_at_change_ms"] = round(aged_s * 1e3)
                self.data.counters[f"state {name}.changes"] += 1

    def _say_lacks(self, now_s: float) -> None:
        """Report what this side lacks, unless it holds. Until the other side is heard it lacks every snapshot."""
        self.data.lack(self._lacks(now_s) if self.stay() is None else {})

    def _lacks(self, now_s: float) -> dict[str, str]:
        """Return why this side does not know a state of the active side, by name of the state."""
        lacks = {}
        for name, state in self.states.items():
            kept = self.kept.get(name)
            if isinstance(state, SnapshotState) and self.standing[name].aged_s(now_s) > state.max_age_s:
                lacks[name] = f"The replica of {state.node} has no snapshot younger than {state.max_age_s * 1e3:.0f} ms"
            elif isinstance(state, SnapshotState) and self._waits(name, now_s):
                lacks[name] = f"The snapshot for the replica of {state.node} has not reached it yet"
            elif isinstance(state, ParameterState) and kept is not None and (kept.refused or not kept.given):
                unset = f"The replica of {state.node} has not got the parameters of the acting side yet"
                lacks[name] = kept.refused or unset
            elif isinstance(state, TopicState) and kept is not None and not kept.given:
                lacks[name] = f"The replica of {state.node} has not taken its state on {state.restore} yet"
        return lacks

    def _waits(self, name: str, now_s: float) -> bool:
        """Return whether a published snapshot may still reach the node here."""
        since_s = self.readings[name].waits_s
        return since_s is not None and now_s - since_s < READ_S

    def arrived(self, name: str, header: bytes, payload: bytes) -> None:
        """Take a state of the other side's node."""
        try:
            opened = self.data.opened(header)
        except EnvelopeError:
            self.data.counters["garbage.envelope"] += 1
            return
        if name not in self.states or not self.accepts(opened.token):
            self.data.counters[f"state {name}.foreign"] += 1
            return
        if not self._whole(name, payload):
            return
        if not self.known(opened.token):
            opened = replace(opened, echo_us=0)
        with self.data.ports.lock:
            taken = snapshots.take(self.standing[name], opened, self.data.ports.now_s())
            if isinstance(taken, Refused):
                self.data.counters[f"state {name}.older"] += 1
                return
            self.standing[name] = taken
        self.data.counters[f"state {name}.restored"] += 1
        state, known = self.states[name], self.kept.get(name)
        if isinstance(state, SnapshotState):
            self._read(name, self.data.ports.now_s())
            self.ports.restore(name, payload)
            self.readings[name].given = taken
        elif isinstance(state, TopicState) or known is None or known.payload != payload:
            self.kept[name] = _Kept(payload, isinstance(state, TopicState) and known is not None and known.given)

    def _whole(self, name: str, payload: bytes) -> bool:
        state = self.states[name]
        if isinstance(state, TopicState):
            return True  # what the middleware carries as one message is whole
        if isinstance(state, ParameterState):
            whole = parameter_values.decode(payload) is not None
            self.data.counters[f"state {name}.refused"] += not whole
            return whole
        found = snapshots.parse(payload, state.max_size)
        refused = isinstance(found, Refused)
        if isinstance(found, Refused):
            node = state.node
            self.data.counters[f"state {name}.refused"] += 1
            self.data.note(f"state {name}", ("SnapshotRefused", f"A snapshot of {node} {found.value}"))
        else:
            self.data.note(f"state {name}", None)
        return not refused

    def _send(self, name: str) -> None:
        """Send only state published during the current stay; the other side already has everything older."""
        token, said = self.holding(), self.said[name]
        if token is None or said.stay != self.stay():
            return
        echo_us = said.echo_us if said.partner in (token.robot, token.cloud) else 0
        with self.data.ports.lock:
            self.sequence += 1
            header = self.data.sealed(Envelope(token, self.sequence, echo_us))
        sent = self.data.ports.cross(f"{CHANNEL}{name}", header, said.payload)
        self.data.counters[f"state {name}.{'sent' if sent else 'unsent'}"] += 1

    def _judge_age(self, name: str, now_s: float) -> None:
        state, aged_s = self.states[name], self.standing[name].aged_s(now_s)
        if isinstance(state, SnapshotState) and self.stands_by() and aged_s > state.max_age_s:
            age = "no snapshot has come" if aged_s == float("inf") else f"the newest snapshot is {aged_s:.1f} s old"
            said = f"The replica of {state.node} does not know the state of the acting side: {age}"
            self.data.note(f"age {name}", ("StateStale", said))
        else:
            self.data.note(f"age {name}", None)

    # -- what each side knows in its own way --------------------------------------------------------------------------

    @abstractmethod
    def holding(self) -> Token | None:
        """Return the token under which this side sends state; None: it does not hold."""

    @abstractmethod
    def stay(self) -> object:
        """Return a value that differs in each stay of this side as the holder; None: it does not hold."""

    @abstractmethod
    def accepts(self, token: Token) -> bool:
        """Return whether state under that token is the holder's, and this side stands by."""

    @abstractmethod
    def known(self, token: Token) -> bool:
        """Return whether the echo reference of a message under that token is a time of our clock."""

    @abstractmethod
    def active(self) -> tuple[str, ...]:
        """Return this side's nodes that are Active."""

    @abstractmethod
    def stands_by(self) -> bool:
        """Return whether the other side holds and can be heard."""


class RobotStates(StateProcess):
    """The robot's side: the collector's memory determines which side holds."""

    data: RobotDataProcess

    def holding(self) -> Token | None:
        """Return the robot's token with the newest epoch that it named; None: the robot does not hold."""
        orders, heard = self.data.orders, self.data.heard
        if self.ports.holder().site is not Site.ROBOT or not orders.incarnation:
            return None
        return Token(orders.incarnation, orders.epoch, heard.incarnation if heard else "")

    def stay(self) -> object:
        """See StateProcess."""
        holder = self.ports.holder()
        return holder.stay if holder.site is Site.ROBOT else None

    def accepts(self, token: Token) -> bool:
        """See StateProcess."""
        holder = self.ports.holder()
        return holder.site is Site.CLOUD and token == holder.token

    def known(self, token: Token) -> bool:
        """See StateProcess."""
        return token.robot == self.data.orders.incarnation

    def active(self) -> tuple[str, ...]:
        """See StateProcess."""
        return self.data.orders.active

    def stands_by(self) -> bool:
        """See StateProcess."""
        return self.ports.holder().site is Site.CLOUD


class CloudStates(StateProcess):
    """The cloud's side: the lease determines which side holds."""

    data: CloudDataProcess

    def holding(self) -> Token | None:
        """See StateProcess."""
        egress = self.data.egress.egress
        return lease.leaves(egress, self.data.ports.now_s()) if egress.in_charge else None

    def stay(self) -> object:
        """See StateProcess."""
        return self.holding()

    def accepts(self, token: Token) -> bool:
        """See StateProcess."""
        robot = self.data.egress.robot
        return self.holding() is None and bool(robot) and token.robot == robot

    def known(self, token: Token) -> bool:
        """See StateProcess."""
        return token.cloud == self.data.egress.incarnation

    def active(self) -> tuple[str, ...]:
        """See StateProcess."""
        return tuple(node for node, state in self.data.egress.nodes if state == State.ACTIVE.value)

    def stands_by(self) -> bool:
        """See StateProcess."""
        return self.holding() is None and bool(self.data.egress.robot)
