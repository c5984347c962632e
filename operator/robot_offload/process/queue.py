"""Which RobotOffload is looked at when: one pass at a time for each, few at once, failing ones ever less often.

Many events for one name become one pass. An event during a pass means one more pass after it.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from typing import Final, Generic, TypeVar

Item = TypeVar("Item")

FIRST_BACKOFF_S: Final = 0.5
LONGEST_BACKOFF_S: Final = 120.0


class Queue(Generic[Item]):
    """Names with the time at which each is due."""

    def __init__(self, steady_s: Callable[[], float], seed: int | None = None) -> None:
        self._steady_s = steady_s
        self._random = random.Random(seed)
        self._due: dict[Item, float] = {}
        self._timers: set[Item] = set()
        self._busy: set[Item] = set()
        self._failures: dict[Item, int] = {}
        self._changed = asyncio.Event()

    def __len__(self) -> int:
        """How many are due or being looked at; timers of the future do not count."""
        now_s = self._steady_s()
        return len(self._busy) + sum(due_s <= now_s for item, due_s in self._due.items() if item not in self._busy)

    def add(self, item: Item, delay_s: float = 0.0) -> None:
        """Something has happened: look at it after `delay_s`, or earlier when that was planned already."""
        self._plan(item, delay_s)
        self._timers.discard(item)

    def remind(self, item: Item, delay_s: float) -> None:
        """Nothing has happened, but time passes: look at it after `delay_s` at the latest."""
        if item not in self._due:
            self._timers.add(item)
        self._plan(item, delay_s)

    def postpone(self, item: Item, delay_s: float) -> None:
        """Moves a reminder further away; what events have planned stays."""
        if item in self._timers:
            self._due[item] = max(self._due[item], self._steady_s() + delay_s)

    def retry(self, item: Item, at_least_s: float = 0.0) -> float:
        """Plans the next attempt after a failure; returns the delay in seconds."""
        failures = self._failures[item] = self._failures.get(item, 0) + 1
        backoff_s = min(LONGEST_BACKOFF_S, FIRST_BACKOFF_S * 2.0 ** min(failures - 1, 16))
        delay_s = max(at_least_s, backoff_s * self._random.uniform(0.75, 1.25))
        self._plan(item, delay_s)
        return delay_s

    def forgive(self, item: Item) -> None:
        """A pass went well: the next failure is the first again."""
        self._failures.pop(item, None)

    async def work(self, look: Callable[[Item], Awaitable[None]]) -> None:
        """Takes what is due, one after the other, until cancelled. Run several of these for several at once."""
        while True:
            item = await self._take()
            try:
                await look(item)
            finally:
                self._busy.discard(item)
                self._changed.set()

    def _plan(self, item: Item, delay_s: float) -> None:
        due_s = self._steady_s() + delay_s
        self._due[item] = min(self._due.get(item, due_s), due_s)
        self._changed.set()

    async def _take(self) -> Item:
        while True:
            self._changed.clear()
            now_s = self._steady_s()
            free = [(due_s, item) for item, due_s in self._due.items() if item not in self._busy]
            if free:
                due_s, item = min(free, key=lambda entry: entry[0])
                if due_s <= now_s:
                    del self._due[item]
                    self._timers.discard(item)
                    self._busy.add(item)
                    return item
            wait_s = min((due_s for due_s, _ in free), default=now_s + 3600.0) - now_s
            try:
                async with asyncio.timeout(max(0.0, wait_s)):
                    await self._changed.wait()
            except TimeoutError:
                continue
