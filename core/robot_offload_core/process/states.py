"""What the data processes do with snapshots of nodes' state: from the holder to the standby, always.

Each side hears its own node. While it holds, it sends what the node said, at once and again every second, because a
standby may come late. What arrives is given to the node here only while the other side holds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Protocol

from robot_offload_core import envelope, snapshots
from robot_offload_core.declared import SnapshotState
from robot_offload_core.envelope import Envelope, EnvelopeError
from robot_offload_core.ledger.ports import Holding
from robot_offload_core.process.cloud_data import CloudDataProcess
from robot_offload_core.process.data import DataProcess
from robot_offload_core.process.robot_data import RobotDataProcess
from robot_offload_core.snapshots import Refused, Standing
from robot_offload_core.token import Site, Token

CHANNEL = "state/"
AGAIN_S = 1.0


class StatePorts(Protocol):
    """What the shell does for the exchange."""

    def restore(self, name: str, payload: bytes) -> None:
        """Gives a snapshot to this side's node, which keeps the newest one until it takes it."""

    def holder(self) -> Holding:
        """Returns who holds, from the collector's memory (robot only)."""


@dataclass
class _Said:
    """The newest snapshot that the node here published, with the stay and the echo reference of that moment."""

    stay: object
    payload: bytes
    echo_us: int
    due_s: float


class StateProcess(ABC):
    """Base of both sides; the data process lends clock, link, lock, counters and problems.

    Attributes:
        sequence: of what was sent last, growing over restarts of this process.
        said: newest of the node here, by name of the entry.
        standing: what the node here has been given, by name of the entry.
    """

    def __init__(self, states: dict[str, SnapshotState], ports: StatePorts, data: DataProcess) -> None:
        self.states = states
        self.ports = ports
        self.data = data
        self.sequence = round(data.ports.now_s() * 1e6)
        self.said: dict[str, _Said] = {}
        self.standing = {name: Standing() for name in states}

    def published(self, name: str, payload: bytes) -> None:
        """Takes what the node here said; what is no whole snapshot goes no further."""
        stay = self.stay()
        if stay is None or not self._whole(name, payload):
            return
        echo_us = self.data.heard.sent_us if self.data.heard else 0
        self.said[name] = _Said(stay, payload, echo_us, self.data.ports.now_s() + AGAIN_S)
        self._send(name)

    def turn(self) -> None:
        """Sends again what is due, and says how old the state of a standby is."""
        now_s = self.data.ports.now_s()
        for name, said in list(self.said.items()):
            if now_s >= said.due_s:
                said.due_s = now_s + AGAIN_S
                self._send(name)
        for name in self.states:
            self._judge_age(name, now_s)

    def arrived(self, name: str, header: bytes, payload: bytes) -> None:
        """Takes a snapshot of the other side's node."""
        try:
            opened = envelope.decode(header)
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
        self.ports.restore(name, payload)

    def _whole(self, name: str, payload: bytes) -> bool:
        found = snapshots.parse(payload, self.states[name].max_size)
        refused = isinstance(found, Refused)
        if isinstance(found, Refused):
            node = self.states[name].node
            self.data.counters[f"state {name}.refused"] += 1
            self.data.note(f"state {name}", ("SnapshotRefused", f"A snapshot of {node} {found.value}"))
        else:
            self.data.note(f"state {name}", None)
        return not refused

    def _send(self, name: str) -> None:
        """Sends what was said in this stay: what is of an earlier one, the other side has known and gone on from."""
        token, said = self.holding(), self.said[name]
        if token is None or said.stay != self.stay():
            return
        with self.data.ports.lock:
            self.sequence += 1
            header = envelope.encode(Envelope(token, self.sequence, said.echo_us))
        sent = self.data.ports.cross(f"{CHANNEL}{name}", header, said.payload)
        self.data.counters[f"state {name}.{'sent' if sent else 'unsent'}"] += 1

    def _judge_age(self, name: str, now_s: float) -> None:
        state, aged_s = self.states[name], self.standing[name].aged_s(now_s)
        if self.stands_by() and aged_s > state.max_age_s:
            age = "no snapshot has come" if aged_s == float("inf") else f"the newest snapshot is {aged_s:.1f} s old"
            said = f"The replica of {state.node} does not know the state of the acting side: {age}"
            self.data.note(f"age {name}", ("StateStale", said))
        else:
            self.data.note(f"age {name}", None)

    # -- what each side knows in its own way --------------------------------------------------------------------------

    @abstractmethod
    def holding(self) -> Token | None:
        """Returns the token under which this side sends state; None: it does not hold."""

    @abstractmethod
    def stay(self) -> object:
        """Returns something that differs in each stay of this side as the holder; None: it does not hold."""

    @abstractmethod
    def accepts(self, token: Token) -> bool:
        """Returns whether a snapshot under that token is the holder's, and this side stands by."""

    @abstractmethod
    def known(self, token: Token) -> bool:
        """Returns whether the echo reference of a message under that token counts on our clock."""

    @abstractmethod
    def stands_by(self) -> bool:
        """Returns whether the other side holds and can be heard."""


class RobotStates(StateProcess):
    """The robot's side: the collector's memory says who holds."""

    data: RobotDataProcess

    def holding(self) -> Token | None:
        """See StateProcess; what goes to the standby carries the newest epoch that the robot named."""
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

    def stands_by(self) -> bool:
        """See StateProcess."""
        return self.ports.holder().site is Site.CLOUD


class CloudStates(StateProcess):
    """The cloud's side: the lease says who holds."""

    data: CloudDataProcess

    def holding(self) -> Token | None:
        """See StateProcess."""
        egress = self.data.egress.egress
        acts = egress.in_charge and self.data.ports.now_s() < egress.lease_end_s
        return egress.token if acts else None

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

    def stands_by(self) -> bool:
        """See StateProcess."""
        return self.holding() is None and bool(self.data.egress.robot)
