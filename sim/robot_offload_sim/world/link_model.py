"""The link between the two hosts: two sessions (pulse, data), each with a wire up and a wire down.

A wire delays, jitters, loses, doubles and reorders, and can be cut in one direction alone. A fault determines whether
messages sent into a cut are lost, or held and delivered late in a burst. The pulse wires carry datagrams. The data
wires keep the order and turn a loss into the delay of a retransmission, unless a fault reorders them or the message is
a datagram (probes).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from robot_offload_sim.world.world import Act, Process, World

HELD_LIMIT = 400
"""Most messages that a cut path buffers."""
BURST_GAP_S = 0.0003
RETRY_S = 0.2
REPLAY_SPREAD_S = 3.0
"""A doubled message arrives again after at most this time, mostly soon."""

STRANGE_S = 0.02
"""Strange messages arrive at most this long before or after the message that they accompany."""


class Wire:
    """One direction of one session.

    Attributes:
        base_s, jitter_s: least delay, and the typical random part added to it.
        extra_s: delay added by faults.
        losses: shares of the active loss faults.
        doubled: share of messages that arrive twice.
        reordering: faults that let messages overtake.
        cut_lost, cut_held: how many active cuts lose or hold messages.
        beside: yields another sender's messages beside this one; None: there is no other sender.
        target: the process at the other end, and its handler of an arrival.
    """

    target: tuple[Process, Act]

    def __init__(self, world: World, session: Session, base_s: float, jitter_s: float, ordered: bool) -> None:
        self.world = world
        self.session = session
        self.base_s = base_s
        self.jitter_s = jitter_s
        self.ordered = ordered
        self.extra_s = 0.0
        self.losses: list[float] = []
        self.doubled = 0.0
        self.reordering = 0
        self.cut_lost = 0
        self.cut_held = 0
        self.beside: Callable[..., Iterator[tuple[Any, ...]]] | None = None
        self._held: list[tuple[Any, ...]] = []
        self._tail_s = 0.0

    def carry(self, *args: Any, datagram: bool = False) -> None:
        """Send: `args` may reach the target later; a datagram has no order and is not sent again when lost."""
        ordered = self.ordered and not datagram
        if not self.session.connected or self.cut_lost:
            return
        if self.cut_held:
            self._hold(args)
            return
        world = self.world
        dice = world.dice
        if self.beside is not None:
            self._let_in(self.beside(dice, *args))
        delay_s = self.base_s + self.extra_s + self.jitter_s * 3.0 * dice.random() ** 2
        for share in self.losses:
            if dice.random() < share:
                if not ordered:
                    return
                delay_s += 2 * (self.base_s + self.extra_s) + 0.02
        if self.reordering:
            delay_s += dice.random() * 0.06
        arrival_s = world.now + delay_s
        if ordered and not self.reordering:
            arrival_s = max(arrival_s, self._tail_s + 1e-9)
            self._tail_s = arrival_s
        world.at(arrival_s, self._arrive, self.session.life, args)
        if self.doubled and dice.random() < self.doubled:
            again_s = arrival_s + dice.random() ** 3 * REPLAY_SPREAD_S
            world.at(again_s, self._arrive, self.session.life, args)

    def _hold(self, args: tuple[Any, ...]) -> None:
        if len(self._held) < HELD_LIMIT:
            self._held.append(args)

    def _let_in(self, strange: Iterator[tuple[Any, ...]]) -> None:
        for args in strange:
            self.world.after(self.base_s + self.world.dice.random() * STRANGE_S, self._arrive, self.session.life, args)

    def _arrive(self, life: int, args: tuple[Any, ...]) -> None:
        if life == self.session.life:
            process, act = self.target
            process.deliver(act, *args)

    def release(self) -> None:
        """Deliver in a burst what the last holding cut kept."""
        if self.cut_held or self.cut_lost:
            return
        held, self._held = self._held, []
        start_s = self.world.now + self.base_s
        for index, args in enumerate(held):
            self.world.at(start_s + index * BURST_GAP_S, self._arrive, self.session.life, args)
        self._tail_s = max(self._tail_s, start_s + len(held) * BURST_GAP_S)

    def forget(self) -> None:
        """Drop what is held."""
        self._held.clear()


class Session:
    """A session over a wire each way.

    Attributes:
        life: messages of an earlier life never arrive.
        connected: whether messages can be sent.
        drops: whether reopening discards messages under way (QUIC does; a DDS transport has nothing to reopen).
    """

    def __init__(self, world: World, base_s: float, jitter_s: float, *, ordered: bool, drops: bool) -> None:
        self.world = world
        self.life = 0
        self.connected = True
        self.drops = drops
        self.up = Wire(world, self, base_s, jitter_s, ordered)
        self.down = Wire(world, self, base_s, jitter_s, ordered)

    def reopen(self) -> None:
        """Close the session, dropping everything in its buffer, and open a new one as soon as the path allows."""
        if not self.drops or not self.connected:
            return
        self.life += 1
        self.connected = False
        self.up.forget()
        self.down.forget()
        self.world.after(0.02 + self.world.dice.random() * 0.1, self._connect, self.life)

    def _connect(self, life: int) -> None:
        if life != self.life:
            return
        if any(wire.cut_lost or wire.cut_held for wire in (self.up, self.down)):
            self.world.after(RETRY_S, self._connect, life)
            return
        handshake_s = 2 * (self.up.base_s + self.up.extra_s + self.down.base_s + self.down.extra_s)
        self.world.after(handshake_s, self._connected, life)

    def _connected(self, life: int) -> None:
        if life == self.life:
            self.connected = True


class Link:
    """The two sessions."""

    def __init__(self, world: World, *, base_s: float, jitter_s: float, drops: bool) -> None:
        self.pulse = Session(world, base_s, jitter_s, ordered=False, drops=drops)
        self.data = Session(world, base_s, jitter_s, ordered=True, drops=drops)
