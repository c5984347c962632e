"""One TCP port of the emulated link: the link delays and holds up byte streams but never breaks them.

Opening, closing and resetting a connection travel through the model like data. So a cut leaves both ends
hanging: the server learns of a new connection, an end or a reset only when that would have got through.
"""

from __future__ import annotations

import enum
import functools
import socket
import struct
from collections import deque
from collections.abc import Callable

from robot_offload_lab.wire.link import Direction, EmulatedLink
from robot_offload_lab.wire.loop import READ, WRITE, Loop, steady_s
from robot_offload_lab.wire.options import Address, Forward
from robot_offload_lab.wire.udp import bound_socket

_WINDOW_BYTES = 1 << 20
"""What one direction may hold before its source is made to wait, as by TCP's window."""

_RESET = struct.pack("ii", 1, 0)  # SO_LINGER of 0 s: closing sends a reset


class _Mark(enum.Enum):
    OPEN = enum.auto()
    FINISH = enum.auto()
    RESET = enum.auto()


class _End:
    """One socket of a connection, with the bytes not yet written."""

    def __init__(self, loop: Loop, count_error: Callable[[], None]) -> None:
        self._loop = loop
        self._count_error = count_error
        self._sock: socket.socket | None = None
        self._connecting = False
        self._finishing = False
        self._reading = False
        self._dead = False
        self._watched = 0
        self._unsent = bytearray()
        self.on_readable: Callable[[], None] = lambda: None
        self.on_sent: Callable[[], None] = lambda: None
        self.on_finished: Callable[[], None] = lambda: None
        self.on_gone: Callable[[], None] = lambda: None

    @property
    def unsent(self) -> int:
        return len(self._unsent)

    def accept(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sock = sock

    def connect(self, target: Address) -> None:
        try:
            family, _, _, _, where = socket.getaddrinfo(target.host, target.port, type=socket.SOCK_STREAM)[0]
            self.accept(socket.socket(family, socket.SOCK_STREAM))
            assert self._sock is not None
            self._connecting = True
            self._sock.connect_ex(where)
        except OSError:
            self._gone()
            return
        self._watch()

    def read(self, size: int) -> bytes | None:
        """Return the bytes that have come; None if none have, empty at the end of the stream.

        Raises:
            OSError: the connection was reset.
        """
        if self._sock is None:
            return None
        try:
            return self._sock.recv(size)
        except BlockingIOError:
            return None

    def set_reading(self, reading: bool) -> None:
        self._reading = reading
        self._watch()

    def write(self, data: bytes) -> None:
        if not self._dead:
            self._unsent += data
            self._flush()

    def finish(self) -> None:
        self._finishing = True
        self._flush()

    def close(self, *, reset: bool = False) -> None:
        if self._sock is None:
            return
        self._loop.watch(self._sock, 0, self._ready)
        if reset:
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
        self._sock.close()
        self._sock = None

    def _watch(self) -> None:
        if self._sock is not None:
            writing = self._connecting or bool(self._unsent)
            reading = self._reading and not self._connecting
            events = READ * reading | WRITE * writing
            if events != self._watched:
                self._watched = events
                self._loop.watch(self._sock, events, self._ready)

    def _ready(self, events: int) -> None:
        if self._connecting and self._sock is not None:
            self._connecting = False
            error = self._sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if error:
                self._gone()
                return
        if events & WRITE:
            self._flush()
        if events & READ and self._reading:
            self.on_readable()

    def _flush(self) -> None:
        if self._sock is None or self._connecting:
            return
        try:
            if self._unsent:
                del self._unsent[: self._sock.send(self._unsent)]
                self.on_sent()
            if self._finishing and not self._unsent:
                self._finishing = False
                self._sock.shutdown(socket.SHUT_WR)
                self.on_finished()
        except BlockingIOError:
            pass
        except OSError:
            self._gone()
            return
        self._watch()

    def _gone(self) -> None:
        self._count_error()
        self._dead = True
        self._unsent.clear()
        self.close()
        self.on_gone()


class _Stream:
    """One direction of a connection: bytes read at `source` reach `sink` when the model determines."""

    def __init__(self, loop: Loop, link: EmulatedLink, direction: Direction, source: _End, sink: _End) -> None:
        self._loop = loop
        self._link = link
        self._direction = direction
        self._model = link.stream(direction)
        self._source = source
        self._sink = sink
        self._flying: deque[tuple[float, bytes | _Mark]] = deque()
        self._held: deque[bytes | _Mark] = deque()
        self._bytes = 0
        self._ended: _Mark | None = None
        self._waiting = False
        self.closed = False
        self.on_mark: Callable[[_Mark], None] = lambda mark: None
        source.on_readable = self.pull
        sink.on_sent = self._resume_if_roomy

    def pull(self) -> None:
        """Read once from the source, as much as link and window can take."""
        if self._ended or self.closed or self._waiting:
            return
        size, wait_s = self._link.room(self._direction, steady_s())
        if not size:
            self._waiting = True
            self._source.set_reading(False)
            self._loop.call_at(steady_s() + wait_s, self._resume)
            return
        try:
            data = self._source.read(size)
        except OSError:
            self.end(_Mark.RESET)
            return
        if data is None:
            return
        if not data:
            self.end(_Mark.FINISH)
            return
        self.offer(data)
        if self._bytes + self._sink.unsent > _WINDOW_BYTES:
            self._source.set_reading(False)

    def end(self, mark: _Mark) -> None:
        """Send the end of this direction; nothing is read after it, and only a reset may follow a finish."""
        if not self.closed and self._ended is not _Mark.RESET and self._ended is not mark:
            self._ended = mark
            self._source.set_reading(False)
            self.offer(mark)

    def offer(self, item: bytes | _Mark) -> None:
        """Put bytes or a mark on the link."""
        size = len(item) if isinstance(item, bytes) else 0
        self._bytes += size
        arrives_s = self._link.offer(self._direction, self._model, steady_s(), size)
        if arrives_s is not None:
            self._flying.append((arrives_s, item))
            self._loop.call_at(arrives_s, self._deliver)
            return
        self._held.append(item)
        if len(self._held) == 1:
            self._await_retry()

    def _await_retry(self) -> None:
        assert self._model.retry_at_s is not None
        self._loop.call_at(self._model.retry_at_s, self._retry)

    def _retry(self) -> None:
        if self.closed:
            return
        size = sum(len(item) for item in self._held if isinstance(item, bytes))
        arrives_s = self._link.retry(self._direction, self._model, steady_s(), size)
        if arrives_s is None:
            self._await_retry()
            return
        self._flying.extend((arrives_s, item) for item in self._held)
        self._held.clear()
        self._loop.call_at(arrives_s, self._deliver)

    def _deliver(self) -> None:
        now_s = steady_s()
        while not self.closed and self._flying and self._flying[0][0] <= now_s:
            item = self._flying.popleft()[1]
            if isinstance(item, bytes):
                self._bytes -= len(item)
                self._sink.write(item)
            else:
                self.on_mark(item)
        self._resume_if_roomy()

    def _resume(self) -> None:
        self._waiting = False
        self._resume_if_roomy()

    def _resume_if_roomy(self) -> None:
        if not (self._ended or self.closed or self._waiting):
            self._source.set_reading(self._bytes + self._sink.unsent <= _WINDOW_BYTES)


class _Connection:
    """Two ends and the two streams between them."""

    def __init__(self, loop: Loop, link: EmulatedLink, client: socket.socket, target: Address) -> None:
        def count(direction: Direction) -> None:
            link.counters[direction].errors += 1

        self._target = target
        self._client = _End(loop, functools.partial(count, "down"))
        self._server = _End(loop, functools.partial(count, "up"))
        self._up = _Stream(loop, link, "up", self._client, self._server)
        self._down = _Stream(loop, link, "down", self._server, self._client)
        self._up.on_mark = functools.partial(self._arrived, self._server)
        self._down.on_mark = functools.partial(self._arrived, self._client)
        self._finished: set[_End] = set()
        self._client.on_finished = functools.partial(self._note_finished, self._client)
        self._server.on_finished = functools.partial(self._note_finished, self._server)
        # The other end learns of the loss through the stream on which the lost end would have sent.
        self._client.on_gone = functools.partial(self._up.end, _Mark.RESET)
        self._server.on_gone = functools.partial(self._down.end, _Mark.RESET)
        self.on_closed: Callable[[_Connection], None] = lambda connection: None
        self._client.accept(client)
        self._up.offer(_Mark.OPEN)
        self._client.set_reading(True)

    def close(self, *, reset: _End | None = None) -> None:
        self._up.closed = self._down.closed = True
        for end in (self._client, self._server):
            end.close(reset=end is reset)
        self.on_closed(self)

    def _arrived(self, sink: _End, mark: _Mark) -> None:
        if mark is _Mark.OPEN:
            sink.connect(self._target)
            sink.set_reading(True)
        elif mark is _Mark.RESET:
            self.close(reset=sink)
        else:
            sink.finish()

    def _note_finished(self, end: _End) -> None:
        self._finished.add(end)
        if len(self._finished) == 2:
            self.close()


class TcpForward:
    """Relays connections."""

    def __init__(self, loop: Loop, link: EmulatedLink, forward: Forward) -> None:
        """Bind the port and listen.

        Raises:
            OSError: the port is taken.
        """
        self._loop = loop
        self._link = link
        self._target = Address.parse(forward.target)
        self._connections: set[_Connection] = set()
        self._listener = bound_socket(socket.SOCK_STREAM, Address.parse(forward.listen))
        self._listener.listen(64)
        loop.watch(self._listener, READ, self._accept)

    @property
    def port(self) -> int:
        """The port that is listened on."""
        return int(self._listener.getsockname()[1])

    @property
    def clients(self) -> int:
        """How many connections are open or hang."""
        return len(self._connections)

    def close(self) -> None:
        """Close all connections; what is under way is lost."""
        for connection in [*self._connections]:
            connection.close()
        self._loop.watch(self._listener, 0, self._accept)
        self._listener.close()

    def forget_idle(self, now_s: float) -> None:
        """Do nothing: a connection ends when its ends say so."""

    def _accept(self, _events: int) -> None:
        try:
            sock, _ = self._listener.accept()
        except OSError:  # gone again, or no more descriptors
            self._link.counters["up"].errors += 1
            return
        connection = _Connection(self._loop, self._link, sock, self._target)
        self._connections.add(connection)
        connection.on_closed = self._connections.discard
