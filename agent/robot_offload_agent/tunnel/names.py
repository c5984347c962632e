"""Resolves names in the background: the tunnel never waits for a name server while it knows an address."""

from __future__ import annotations

import asyncio
import socket

from robot_offload_agent.tunnel.configuration import Address

FIRST_LOOKUP_S = 2.0


class Names:
    """The addresses behind names; keeps the last good answer, because a name server is often lost with the link."""

    def __init__(self) -> None:
        self._known: dict[Address, tuple[str, ...]] = {}
        self._lookups: dict[Address, asyncio.Task[None]] = {}

    async def hosts(self, address: Address) -> tuple[str, ...]:
        """Return IP addresses; empty: not known yet. Start a new lookup each time, one at a time for each name."""
        if not address.is_name:
            return (address.host,)
        lookup = self._lookups.get(address)
        if lookup is None or lookup.done():
            lookup = self._lookups[address] = asyncio.create_task(self._look_up(address))
        if address not in self._known:
            await asyncio.wait([lookup], timeout=FIRST_LOOKUP_S)
        return self._known.get(address, ())

    async def _look_up(self, address: Address) -> None:
        try:
            found = await asyncio.get_running_loop().getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
        except OSError:
            return
        self._known[address] = tuple(dict.fromkeys(str(one[4][0]) for one in found))
