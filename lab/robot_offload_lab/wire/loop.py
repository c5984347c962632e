"""A select loop with sockets and moments, whose timers are accurate to some tens of microseconds.

asyncio and epoll round their waits up to whole milliseconds, which would be most of the delay that the wire
may add. `select` waits in microseconds: here it waits for the epoll descriptor, so that the number of
sockets is not limited.
"""

from __future__ import annotations

import heapq
import itertools
import select
import selectors
import socket
import time
from collections.abc import Callable

READ = selectors.EVENT_READ
WRITE = selectors.EVENT_WRITE


def steady_s() -> float:
    """Return this host's steady time, the same clock as the agents': it goes on while the host sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Loop:
    """Calls back when a socket is ready and when a moment has come; one thread."""

    def __init__(self) -> None:
        self._selector = selectors.EpollSelector()
        self._moments: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()

    def call_at(self, when_s: float, action: Callable[[], None]) -> None:
        """Call `action` at `when_s`; actions of the same moment run in the order of registration."""
        heapq.heappush(self._moments, (when_s, next(self._order), action))

    def watch(self, sock: socket.socket, events: int, action: Callable[[int], None]) -> None:
        """Call `action` with the events that have occurred; replaces an earlier watch; 0 events end it."""
        known = sock.fileno() in self._selector.get_map()
        if not events:
            if known:
                self._selector.unregister(sock)
        elif known:
            self._selector.modify(sock, events, action)
        else:
            self._selector.register(sock, events, action)

    def run_once(self) -> None:
        """Wait for the next socket or moment and call back; without a registered moment this may wait forever."""
        wait_s = max(0.0, self._moments[0][0] - steady_s()) if self._moments else None
        if select.select([self._selector], [], [], wait_s)[0]:
            for key, events in self._selector.select(0):
                key.data(events)
        now_s = steady_s()
        while self._moments and self._moments[0][0] <= now_s:
            heapq.heappop(self._moments)[2]()

    def close(self) -> None:
        """Forget all sockets and moments; their owners close the sockets."""
        self._selector.close()
        self._moments.clear()
