"""When each RobotOffload is processed: one pass at a time for each, few at once, failing ones ever less often.

Many events for one name become one pass. An event during a pass means one more pass after it. A person's change goes
before everything else that is due.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import random
from collections.abc import Awaitable, Callable
from typing import Final, Generic, TypeVar

Item = TypeVar("Item")

FIRST_BACKOFF_S: Final = 0.5
LONGEST_BACKOFF_S: Final = 120.0


class Queue(Generic[Item]):
    """Names with the time at which each is due, in two heaps: the waiting ones, and the due ones."""

    def __init__(
        self,
        steady_s: Callable[[], float],
        seed: int | None = None,
        waited: Callable[[float], None] = lambda _waited_s: None,
    ) -> None:
        """Create an empty queue; `waited` gets the seconds between due and taken, for each taken one."""
        self._steady_s = steady_s
        self._waited = waited
        self._random = random.Random(seed)
        self._due: dict[Item, float] = {}
        self._urgent: set[Item] = set()
        self._timers: set[Item] = set()
        self._busy: set[Item] = set()
        self._failures: dict[Item, int] = {}
        # Entries of the heaps are never removed when plans change; obsolete ones are skipped.
        self._later: list[tuple[float, int, Item]] = []
        self._ready: list[tuple[bool, float, int, Item]] = []
        self._numbers = itertools.count()
        self._changed = asyncio.Event()

    def __len__(self) -> int:
        """Return how many are due or being processed; those of the future do not count."""
        now_s = self._steady_s()
        return len(self._busy) + sum(due_s <= now_s for item, due_s in self._due.items() if item not in self._busy)

    @property
    def late_s(self) -> float:
        """Return for how many seconds the oldest one has been due; 0: none is."""
        now_s = self._steady_s()
        return max((now_s - due_s for item, due_s in self._due.items() if item not in self._busy), default=0.0)

    def add(self, item: Item, delay_s: float = 0.0, *, urgent: bool = False) -> None:
        """Plan a pass because something has happened: after `delay_s`, or earlier if already planned.

        Args:
            item: to process.
            delay_s: seconds to wait for further events.
            urgent: whether it goes before others that are due.
        """
        if urgent:
            self._urgent.add(item)
        self._plan(item, delay_s)
        self._timers.discard(item)

    def remind(self, item: Item, delay_s: float) -> None:
        """Plan a pass without an event, because time passes: after `delay_s` at the latest."""
        if item not in self._due:
            self._timers.add(item)
        self._plan(item, delay_s)

    def postpone(self, item: Item, delay_s: float) -> None:
        """Postpone a reminder; what events have planned stays."""
        if item in self._timers:
            due_s = max(self._due[item], self._steady_s() + delay_s)
            if due_s > self._due[item]:
                self._due[item] = due_s
                heapq.heappush(self._later, (due_s, next(self._numbers), item))

    def retry(self, item: Item, at_least_s: float = 0.0) -> float:
        """Plan the next attempt after a failure; return the delay in seconds."""
        failures = self._failures[item] = self._failures.get(item, 0) + 1
        backoff_s = min(LONGEST_BACKOFF_S, FIRST_BACKOFF_S * 2.0 ** min(failures - 1, 16))
        delay_s = max(at_least_s, backoff_s * self._random.uniform(0.75, 1.25))
        self._plan(item, delay_s)
        return delay_s

    def forgive(self, item: Item) -> None:
        """Record that a pass succeeded: the next failure counts as the first."""
        self._failures.pop(item, None)

    async def work(self, look: Callable[[Item], Awaitable[None]]) -> None:
        """Process what is due, one after the other, until cancelled. Run several of these for concurrency."""
        while True:
            item = await self._take()
            try:
                await look(item)
            finally:
                self._busy.discard(item)
                if item in self._due:  # planned again meanwhile
                    heapq.heappush(self._later, (self._due[item], next(self._numbers), item))
                self._changed.set()

    def _plan(self, item: Item, delay_s: float) -> None:
        due_s = self._steady_s() + delay_s
        known_s = self._due.get(item)
        if known_s is None or due_s < known_s or item in self._urgent:
            self._due[item] = due_s = min(due_s, due_s if known_s is None else known_s)
            heapq.heappush(self._later, (due_s, next(self._numbers), item))
            self._changed.set()

    async def _take(self) -> Item:
        while True:
            self._changed.clear()
            now_s = self._steady_s()
            self._promote(now_s)
            while self._ready:
                _, due_s, _, item = heapq.heappop(self._ready)
                if self._due.get(item) == due_s and item not in self._busy:
                    del self._due[item]
                    self._timers.discard(item)
                    self._urgent.discard(item)
                    self._busy.add(item)
                    self._waited(max(0.0, now_s - due_s))
                    return item
            wait_s = self._later[0][0] - now_s if self._later else 3600.0
            try:
                async with asyncio.timeout(max(0.0, wait_s)):
                    await self._changed.wait()
            except TimeoutError:
                continue

    def _promote(self, now_s: float) -> None:
        """Move what has become due from one heap to the other."""
        while self._later and self._later[0][0] <= now_s:
            due_s, number, item = heapq.heappop(self._later)
            if self._due.get(item) == due_s and item not in self._busy:
                heapq.heappush(self._ready, (item not in self._urgent, due_s, number, item))
