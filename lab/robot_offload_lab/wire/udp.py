"""One UDP port of the emulated link: datagrams between many clients and one server, through the model."""

from __future__ import annotations

import functools
import socket
from typing import Any

from robot_offload_lab.wire.link import Direction, EmulatedLink
from robot_offload_lab.wire.loop import READ, Loop, steady_s
from robot_offload_lab.wire.options import Address, Forward

IDLE_S = 30.0
"""A client that has been silent this long, in both directions, is forgotten, as a NAT would."""

_LARGEST = 65535
_BURST = 64  # datagrams read at once before timers get their turn
_BUFFER_BYTES = 4 << 20


def bound_socket(kind: socket.SocketKind, address: Address) -> socket.socket:
    """Return a non-blocking socket bound to `address`.

    Raises:
        OSError: the address is taken or not of this host.
    """
    family, _, _, _, where = socket.getaddrinfo(address.host, address.port, type=kind)[0]
    sock = socket.socket(family, kind)
    try:
        if kind == socket.SOCK_STREAM:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setblocking(False)
        sock.bind(where)
    except OSError:
        sock.close()
        raise
    return sock


class _Client:
    """A robot's source port, with a socket of its own towards the server, as behind a NAT."""

    def __init__(self, address: Any, target: Address) -> None:
        family, _, _, _, where = socket.getaddrinfo(target.host, target.port, type=socket.SOCK_DGRAM)[0]
        self.address = address
        self.active_s = steady_s()
        self.to_server = socket.socket(family, socket.SOCK_DGRAM)
        self.to_server.setblocking(False)
        _enlarge(self.to_server)
        self.to_server.connect(where)


class UdpForward:
    """Relays datagrams; survives an absent server (ICMP errors) and clients that come and go."""

    def __init__(self, loop: Loop, link: EmulatedLink, forward: Forward) -> None:
        """Bind the port.

        Raises:
            OSError: the port is taken.
        """
        self._loop = loop
        self._link = link
        self._target = Address.parse(forward.target)
        self._clients: dict[Any, _Client] = {}
        self._listener = bound_socket(socket.SOCK_DGRAM, Address.parse(forward.listen))
        _enlarge(self._listener)
        loop.watch(self._listener, READ, self._from_clients)

    @property
    def port(self) -> int:
        """The port that is listened on."""
        return int(self._listener.getsockname()[1])

    @property
    def clients(self) -> int:
        """How many clients are known."""
        return len(self._clients)

    def close(self) -> None:
        """Close all sockets; what is under way is lost."""
        for client in [*self._clients.values()]:
            self._forget(client)
        self._loop.watch(self._listener, 0, self._from_clients)
        self._listener.close()

    def forget_idle(self, now_s: float) -> None:
        """Close the sockets of clients that have been silent for `IDLE_S`."""
        for client in [*self._clients.values()]:
            if now_s - client.active_s > IDLE_S:
                self._forget(client)

    def _forget(self, client: _Client) -> None:
        del self._clients[client.address]
        self._loop.watch(client.to_server, 0, self._from_clients)
        client.to_server.close()

    def _from_clients(self, _events: int) -> None:
        for _ in range(_BURST):
            try:
                data, address = self._listener.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError:
                self._link.counters["up"].errors += 1
                return
            now_s = steady_s()
            client = self._clients.get(address) or self._welcome(address)
            if client is None:
                continue
            client.active_s = now_s
            arrives_s = self._link.datagram("up", now_s, len(data))
            if arrives_s is not None:
                self._loop.call_at(arrives_s, functools.partial(self._to_server, client, data))

    def _welcome(self, address: Any) -> _Client | None:
        try:
            client = _Client(address, self._target)
        except OSError:  # no route, no more descriptors: this datagram is lost, the next may fare better
            self._link.counters["up"].errors += 1
            return None
        self._clients[address] = client
        self._loop.watch(client.to_server, READ, functools.partial(self._from_server, client))
        return client

    def _from_server(self, client: _Client, _events: int) -> None:
        for _ in range(_BURST):
            try:
                data = client.to_server.recv(_LARGEST)
            except BlockingIOError:
                return
            except OSError:  # ECONNREFUSED: no program listens there at the moment
                self._link.counters["down"].errors += 1
                return
            now_s = steady_s()
            client.active_s = now_s
            arrives_s = self._link.datagram("down", now_s, len(data))
            if arrives_s is not None:
                self._loop.call_at(arrives_s, functools.partial(self._to_client, client, data))

    def _to_server(self, client: _Client, data: bytes) -> None:
        if client.to_server.fileno() < 0:
            return
        try:
            client.to_server.send(data)
        except ConnectionRefusedError:
            # The kernel reports an ICMP error of an earlier datagram here and has not sent this one.
            self._link.counters["up"].errors += 1
            self._send("up", functools.partial(client.to_server.send, data))
        except OSError:
            self._link.counters["up"].errors += 1

    def _to_client(self, client: _Client, data: bytes) -> None:
        if self._listener.fileno() >= 0:
            self._send("down", functools.partial(self._listener.sendto, data, client.address))

    def _send(self, direction: Direction, send: functools.partial[int]) -> None:
        try:
            send()
        except OSError:
            self._link.counters[direction].errors += 1


def _enlarge(sock: socket.socket) -> None:
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
        sock.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
