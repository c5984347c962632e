"""Virtual time: one heap of events, one seed, two hosts with clocks of their own, and processes that can be stopped.

This module does not know the protocol. A run is a pure function of its seed: no real clock, no threads, no iteration
over sets. True time is seconds since the start of the run; only the observer and the models of wires and wheels may
read it. The shells read the steady clock of their host, which has another origin and runs up to 200 ppm fast or slow.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any

TRACE_LENGTH = 400
"""Notes kept for the report of a violation."""
IPC_LEAST_S = 0.00005
IPC_SPREAD_S = 0.00195
"""Hand-over between two processes of a host: 0.05 to 2 ms, mostly short."""
REPLIES_KEPT = 10
"""Answers per service that wait for a stopped process: the middleware's history, keep last 10."""
SOCKET_BYTES = 212_992
"""Bytes that one sender may have waiting in another process's socket: the kernel's default."""
ROW_S = 0.5
"""A process whose stops end less than this apart is starved; these stops form one row."""
LONG_S = 0.2
"""A stop longer than this counts separately: the delays that it caused are excused anew."""

Act = Callable[..., Any]


class World:
    """The event heap and the virtual clock.

    Attributes:
        now: true time, seconds.
        dice: the only source of randomness.
        inbox_limit: datagrams that wait for a stopped process; the kernel refuses further ones, so the process finds
            the *oldest* when it continues.
        size_of: bytes of the words of a datagram.
        trace: the latest notes (time, words), for the story before a violation.
    """

    def __init__(self, seed: str) -> None:
        self.now = 0.0
        self.inbox_limit = 64
        self.size_of: Callable[[tuple[Any, ...]], int] = lambda _words: 0
        self.dice = random.Random(seed)
        self.trace: deque[tuple[float, tuple[object, ...]]] = deque(maxlen=TRACE_LENGTH)
        self.events = 0
        self._heap: list[tuple[float, int, Act, tuple[Any, ...]]] = []
        self._count = 0

    def at(self, time_s: float, act: Act, *args: Any) -> None:
        """Plan `act(*args)` for `time_s`; equal times keep the order of planning."""
        self._count += 1
        heappush(self._heap, (time_s, self._count, act, args))

    def after(self, delay_s: float, act: Act, *args: Any) -> None:
        """Plan `act(*args)` in `delay_s`."""
        self._count += 1
        heappush(self._heap, (self.now + delay_s, self._count, act, args))

    def note(self, *words: object) -> None:
        """Keep words for the story; they become text only when the story is requested."""
        self.trace.append((self.now, words))

    def story(self, length: int) -> tuple[str, ...]:
        """Return the latest notes as lines of text."""
        notes = list(self.trace)[-length:]
        return tuple(f"{time_s:9.4f}  " + " ".join(str(word) for word in words) for time_s, words in notes)

    def run(self, until_s: float) -> None:
        """Run up to `until_s`."""
        heap = self._heap
        events = 0
        while heap and heap[0][0] <= until_s:
            self.now, _, act, args = heappop(heap)
            act(*args)
            events += 1
        self.events += events
        self.now = until_s


class Host:
    """One computer: its steady clock, its system clock, and the processes that freeze with it.

    Attributes:
        offset_s, rate: of the steady clock against true time.
        wall_us: system clock minus steady clock, microseconds.
        frozen: whether the whole host stands still (a paused virtual machine whose steady clock goes on).
        stands: (start, end) in true time of each standstill of the host with its steady clock.
    """

    def __init__(self, world: World, name: str) -> None:
        self.world = world
        self.name = name
        self.offset_s = world.dice.uniform(100.0, 50000.0)
        self.rate = 1.0 + world.dice.uniform(-200e-6, 200e-6)
        self.wall_us = round((1.7e9 - self.offset_s) * 1e6) + world.dice.randrange(-1500, 1500)
        self.frozen = 0
        self.stands: list[tuple[float, float]] = []
        self._pace = self.rate
        self.processes: list[Process] = []

    def now_s(self) -> float:
        """Return the steady clock."""
        return self.offset_s + self.world.now * self.rate

    def system_s(self) -> float:
        """Return the system clock, which stamps messages."""
        return self.now_s() + self.wall_us / 1e6

    def freeze(self) -> None:
        """Stop every process of this host."""
        self.frozen += 1
        for process in self.processes:
            process.stop()

    def stand(self, duration_s: float) -> None:
        """Stop every process and the steady clock; the system clock is right again at the end."""
        if self.frozen:
            return
        self.freeze()
        self.stands.append((self.world.now, self.world.now + duration_s))
        self.offset_s, self.rate = self.now_s(), 0.0
        self.world.after(duration_s, self._go_on, duration_s)

    def _go_on(self, duration_s: float) -> None:
        self.offset_s, self.rate = self.offset_s - self.world.now * self._pace, self._pace
        self.wall_us += round(duration_s * 1e6)
        self.thaw()

    def stood_since(self, true_s: float) -> float:
        """Return how long the steady clock has stood still since a true time."""
        return sum(max(0.0, end_s - max(start_s, true_s)) for start_s, end_s in self.stands)

    def thaw(self) -> None:
        """Continue them."""
        self.frozen -= 1
        for process in self.processes:
            process.resume()


class Process:
    """A process under a supervisor: it can be killed (and comes back), stopped and continued.

    Messages that arrive while it is stopped wait in its inbox, up to the world's limit; timers that became due
    meanwhile fire once after the inbox was read, as in the shells.

    Attributes:
        alive: whether it runs (or is stopped); False while the supervisor restarts it.
        stops: number of reasons that keep it stopped.
        life: increases with each start; actions planned by an earlier life are void.
        running_since_s: true time of the last start or continuation.
        row: stops so far with less than ROW_S between their ends.
        row_s: true time at which the first of them ended, or the last long one.
        stood_s: how long the last stop lasted.
        blink_s: the process may not notice a shorter stop, which belongs to a row but does not prolong it.
    """

    def __init__(self, world: World, host: Host, name: str) -> None:
        self.world = world
        self.host = host
        self.name = name
        self.alive = False
        self.stops = 0
        self.life = 0
        self.running_since_s = 0.0
        self.row = 0
        self.row_s = 0.0
        self.stood_s = 0.0
        self.blink_s = 0.0
        self._row_end_s = 0.0
        self._stopped_s = 0.0
        self._inbox: deque[tuple[Act, tuple[Any, ...]]] = deque()
        self._waiting: dict[str, int] = {}
        self._replies: dict[str, int] = {}
        self._overdue: list[tuple[float | None, Act]] = []
        self._tails: dict[str, float] = {}
        host.processes.append(self)

    @property
    def running(self) -> bool:
        """Return whether it is alive and not stopped."""
        return self.alive and not self.stops

    def starved(self) -> bool:
        """Return whether it is, or was last, stopped in slices, that is, again soon after a stop."""
        return self.row > 1 or (self.stops > 0 and self.row > 0 and self._stopped_s - self.running_since_s < ROW_S)

    def boot(self) -> None:
        """Set the first state and the timers, as subclasses define them; called at each start."""
        raise NotImplementedError

    def start(self) -> None:
        """Start a new life."""
        self.alive = True
        self.life += 1
        self.stops = self.host.frozen
        self.running_since_s = self.row_s = self._row_end_s = self.world.now
        self.row = 0
        self._inbox.clear()
        self._waiting.clear()
        self._replies.clear()
        self._overdue.clear()
        if self.stops:
            self._inbox.append((self.boot, ()))
        else:
            self.boot()

    def kill(self, restart_after_s: float) -> None:
        """Kill it (SIGKILL); the supervisor restarts it."""
        if not self.alive:
            return
        self.world.note("killed", self.name)
        self.alive = False
        self.life += 1
        self._inbox.clear()
        self._overdue.clear()
        self.world.after(restart_after_s, self.start)

    def stop(self) -> None:
        """Stop it (SIGSTOP; stops add up)."""
        if not self.alive:
            return
        self.stops += 1
        if self.stops == 1:
            self._stopped_s = self.world.now

    def resume(self) -> None:
        """Continue it (SIGCONT): arrivals are read first, then due actions run."""
        if not self.alive or not self.stops:
            return
        self.stops -= 1
        if self.stops:
            return
        life = self.life
        self._waiting.clear()
        self._replies.clear()
        self.row = self.row + 1 if self.world.now - self._row_end_s < ROW_S else 1
        self.running_since_s = self.world.now
        self.stood_s = self.running_since_s - self._stopped_s
        if self.row == 1 or self.stood_s >= self.blink_s:
            self._row_end_s = self.running_since_s
        if self.row == 1 or self.stood_s > LONG_S:
            self.row_s = self.running_since_s
        while self._inbox and self.life == life:
            act, args = self._inbox.popleft()
            act(*args)
        overdue, self._overdue = self._overdue, []
        for period_s, act in overdue:
            self._fire(life, period_s, act)

    def stop_for(self, duration_s: float) -> None:
        """Stop it, and continue it after `duration_s` unless it was killed in between."""
        if self.alive:
            self.world.note("stopped", self.name, duration_s)
            self.stop()
            self.world.after(duration_s, self._resume_life, self.life)

    def _resume_life(self, life: int) -> None:
        if life == self.life:
            self.world.note("continued", self.name)
            self.resume()

    def every(self, period_s: float, act: Act, first_s: float | None = None) -> None:
        """Start a timer of this life, `first_s` from now, or at a random phase."""
        delay_s = self.world.dice.random() * period_s if first_s is None else first_s
        self.world.after(delay_s, self._fire, self.life, period_s, act)

    def once(self, delay_s: float, act: Act) -> None:
        """Plan `act` once in this life."""
        self.world.after(delay_s, self._fire, self.life, None, act)

    def _fire(self, life: int, period_s: float | None, act: Act) -> None:
        if life != self.life:
            return
        if self.stops:
            self._overdue.append((period_s, act))
            return
        if period_s is not None:
            self.world.after(period_s + self.world.dice.random() * 1e-4, self._fire, life, period_s, act)
        act()

    def _datagrams(self) -> int:
        return len(self._inbox) - sum(self._replies.values())

    def deliver(self, act: Act, *args: Any) -> None:
        """Deliver something: handled now, kept while stopped, lost while dead."""
        if not self.alive:
            return
        if not self.stops:
            act(*args)
        elif self._datagrams() < self.world.inbox_limit:
            self._inbox.append((act, args))

    def post(self, sender: str, act: Act, *args: Any) -> None:
        """Hand over a local datagram from `sender`: short random delay, order kept per sender."""
        self.world.at(self._arrival_s(sender), self._take_in, sender, act, args)

    def reply(self, sender: str, service: str, act: Act, *args: Any) -> None:
        """Hand over a server's answer; while the process is stopped, the middleware keeps some per service."""
        self.world.at(self._arrival_s(sender), self._take_reply, service, act, args)

    def _arrival_s(self, sender: str) -> float:
        world = self.world
        arrival_s = world.now + IPC_LEAST_S + world.dice.random() ** 4 * IPC_SPREAD_S
        tail_s = self._tails.get(sender, 0.0)
        if arrival_s <= tail_s:
            arrival_s = tail_s + 1e-9
        self._tails[sender] = arrival_s
        return arrival_s

    def _take_reply(self, service: str, act: Act, args: tuple[Any, ...]) -> None:
        if not self.alive:
            return
        if not self.stops:
            act(*args)
        elif self._replies.get(service, 0) < REPLIES_KEPT:
            self._replies[service] = self._replies.get(service, 0) + 1
            self._inbox.append((act, args))

    def _take_in(self, sender: str, act: Act, args: tuple[Any, ...]) -> None:
        """Take it as `deliver` does; the bytes that one sender may have waiting are limited too."""
        if not self.alive:
            return
        if not self.stops:
            act(*args)
        elif self._datagrams() < self.world.inbox_limit:
            waiting = self._waiting.get(sender, 0) + self.world.size_of(args)
            if waiting <= SOCKET_BYTES:
                self._waiting[sender] = waiting
                self._inbox.append((act, args))
