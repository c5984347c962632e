"""What the two relays write to each other: a small binary form, parsed strictly on arrival.

A frame: magic and version 4, incarnation of the writer 16, of the reader 16 (zeros: not known yet), number 8, kind 1,
then the fields of the kind in order. Number 0: a word that is written once and not acknowledged.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum, IntEnum
from typing import Any, get_type_hints

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.ports import Face, GoalStatus

MAGIC = b"RR\0\1"
HEAD = struct.Struct(">4s16s16sQB")
MAX_NAME = 256
MAX_BYTES = 1024 * 1024 + 64
"""Limit of one payload."""
MAX_LIST = 1024
NOBODY = bytes(16)


class WordError(ValueError):
    """Bytes that are not a frame of a relay; `reason`: BadForm or OtherVersion."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


class CallVerdict(IntEnum):
    """What became of a request."""

    DONE = 1
    NOT_HOLDER = 2
    """Nothing was executed, and nothing will ever be executed under this number."""
    REFUSED = 3
    """By the server, or because no side may call it."""
    FAILED = 4
    """Executed, and the response contains `success: false`."""


@dataclass(frozen=True)
class Hello:
    """Sent each 100 ms and at changes: the writer's identity and the levels that the other relay needs.

    Attributes:
        agent: incarnation of the writer's control process; "" while it is not known.
        site: the holder, as the robot states it; the cloud repeats what it received.
        stay: the holder's stay, see `ports.Holding`.
        up: served names whose server is seen and whose node is Active, on the writer's side.
        executing: actions that the writer's side executes.
    """

    agent: str
    site: Site
    stay: int
    up: tuple[str, ...] = ()
    executing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Ack:
    """Numbers of the letters that arrived."""

    numbers: tuple[int, ...]


@dataclass(frozen=True)
class OfferWord:
    """A goal for a server of the reader's side. `mirror`: needs no lease, only the newest epoch."""

    face: Face
    action: str
    attempt: bytes
    token: Token
    mirror: bool
    payload: bytes


@dataclass(frozen=True)
class CancelWord:
    """Order to end an attempt."""

    face: Face
    action: str
    attempt: bytes


@dataclass(frozen=True)
class ResumeWord:
    """Order to continue an attempt under this token, or as a mirror; the reader reports its state again."""

    face: Face
    action: str
    attempt: bytes
    token: Token
    mirror: bool


@dataclass(frozen=True)
class CallWord:
    """A service call for a server of the reader's side. `standby`: needs no lease, only the newest epoch."""

    face: Face
    service: str
    key: int
    token: Token
    standby: bool
    payload: bytes


@dataclass(frozen=True)
class OfferedWord:
    """The answer to an offer."""

    face: Face
    attempt: bytes
    verdict: CallVerdict


@dataclass(frozen=True)
class EndedWord:
    """How an attempt ended; status UNKNOWN: its server has forgotten it."""

    face: Face
    attempt: bytes
    status: GoalStatus
    under_lease: bool
    payload: bytes


@dataclass(frozen=True)
class CalledWord:
    """The answer to a call."""

    face: Face
    key: int
    verdict: CallVerdict
    payload: bytes


@dataclass(frozen=True)
class FeedbackWord:
    """Feedback of an attempt; written once."""

    face: Face
    action: str
    sequence: int
    payload: bytes


Word = (
    Hello | Ack | OfferWord | CancelWord | ResumeWord | CallWord | OfferedWord | EndedWord | CalledWord | FeedbackWord
)
KINDS: tuple[type[Any], ...] = (
    Hello, Ack, OfferWord, CancelWord, ResumeWord, CallWord, OfferedWord, EndedWord, CalledWord, FeedbackWord,
)  # fmt: skip
"""The index in this tuple is the number of the kind: only ever append."""


@dataclass(frozen=True)
class RelayFrame:
    """A word with its address. `reader` is "" while the writer does not know its reader yet."""

    writer: str
    reader: str
    number: int
    word: Word


# -- fields -----------------------------------------------------------------------------------------------------------


class Reader:
    """Reads fields off bytes; every method raises WordError."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, size: int) -> bytes:
        """Return the next bytes."""
        if self.at + size > len(self.data):
            raise WordError("BadForm", "a frame ends too early")
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, size: int = 8) -> int:
        """Return an unsigned number."""
        return int.from_bytes(self.take(size), "big")

    def text(self) -> str:
        """Return a name."""
        size = self.number(2)
        if size > MAX_NAME:
            raise WordError("BadForm", f"a name of {size} bytes")
        try:
            return self.take(size).decode()
        except UnicodeDecodeError as error:
            raise WordError("BadForm", "a name that is no text") from error

    def payload(self) -> bytes:
        """Return a payload."""
        size = self.number(4)
        if size > MAX_BYTES:
            raise WordError("BadForm", f"a payload of {size} bytes")
        return self.take(size)

    def count(self) -> int:
        """Return the length of a list."""
        count = self.number(2)
        if count > MAX_LIST:
            raise WordError("BadForm", f"a list of {count}")
        return count

    def incarnation(self) -> str:
        """Return an incarnation, "" for none."""
        found = self.take(16)
        return "" if found == NOBODY else found.hex()

    def token(self) -> Token:
        """Return a token."""
        return Token(self.incarnation(), self.number(), self.incarnation())

    def one_of(self, kind: type[Enum]) -> Any:
        """Return a member of an enumeration by its integer value, otherwise by its place."""
        number = self.number(1)
        members = list(kind)
        found = [m for m in members if (m.value if isinstance(m.value, int) else members.index(m) + 1) == number]
        if not found:
            raise WordError("BadForm", f"{number} is none of {kind!r:.60}")
        return found[0]


def _text(value: str) -> bytes:
    data = value.encode()
    return len(data).to_bytes(2, "big") + data


def _incarnation(value: str) -> bytes:
    return bytes.fromhex(value) if value else NOBODY


def _token(value: Token) -> bytes:
    return _incarnation(value.robot) + value.epoch.to_bytes(8, "big") + _incarnation(value.cloud)


def _member(value: Enum) -> bytes:
    number = value.value if isinstance(value.value, int) else list(type(value)).index(value) + 1
    return bytes([number])


_WRITE: dict[Any, Callable[[Any], bytes]] = {
    str: _text,
    int: lambda value: value.to_bytes(8, "big"),
    bool: lambda value: bytes([value]),
    bytes: lambda value: len(value).to_bytes(4, "big") + value,
    Token: _token,
    Site: _member,
    Face: _member,
    GoalStatus: _member,
    CallVerdict: _member,
    tuple[str, ...]: lambda value: len(value).to_bytes(2, "big") + b"".join(map(_text, value)),
    tuple[int, ...]: lambda value: len(value).to_bytes(2, "big") + b"".join(n.to_bytes(8, "big") for n in value),
}


def _flag(reader: Reader) -> bool:
    value = reader.number(1)
    if value > 1:
        raise WordError("BadForm", f"{value} is no flag")
    return bool(value)


_READ: dict[Any, Callable[[Reader], Any]] = {
    str: Reader.text,
    int: Reader.number,
    bool: _flag,
    bytes: Reader.payload,
    Token: Reader.token,
    Site: lambda reader: reader.one_of(Site),
    Face: lambda reader: reader.one_of(Face),
    GoalStatus: lambda reader: reader.one_of(GoalStatus),
    CallVerdict: lambda reader: reader.one_of(CallVerdict),
    tuple[str, ...]: lambda reader: tuple(reader.text() for _ in range(reader.count())),
    tuple[int, ...]: lambda reader: tuple(reader.number() for _ in range(reader.count())),
}


def _forms() -> dict[type[Any], tuple[Any, ...]]:
    hints = {kind: get_type_hints(kind) for kind in KINDS}
    return {kind: tuple(hints[kind][field.name] for field in fields(kind)) for kind in KINDS}


_FORMS = _forms()

# -- frames -----------------------------------------------------------------------------------------------------------


def encode(frame: RelayFrame) -> bytes:
    """Return the frame's bytes."""
    kind = type(frame.word)
    head = HEAD.pack(
        MAGIC, _incarnation(frame.writer), _incarnation(frame.reader), frame.number, KINDS.index(kind)
    )  # fmt: skip
    values = (getattr(frame.word, field.name) for field in fields(kind))
    return head + b"".join(_WRITE[form](value) for form, value in zip(_FORMS[kind], values, strict=True))


def decode(data: bytes) -> RelayFrame:
    """Read a frame; raise WordError for anything else."""
    if len(data) < HEAD.size:
        raise WordError("BadForm", f"{len(data)} bytes are no frame")
    magic, writer, reader, number, kind = HEAD.unpack_from(data)
    if magic != MAGIC:
        other = magic[:3] == MAGIC[:3]
        raise WordError("OtherVersion" if other else "BadForm", f"version {magic!r}, this side speaks {MAGIC!r}")
    if kind >= len(KINDS):
        raise WordError("BadForm", f"{kind} is no kind of word")
    rest = Reader(data)
    rest.at = HEAD.size
    values = [_READ[form](rest) for form in _FORMS[KINDS[kind]]]
    if rest.at != len(data):
        raise WordError("BadForm", f"{len(data) - rest.at} bytes too many")
    word = KINDS[kind](*values)
    attempt = getattr(word, "attempt", None)
    if attempt is not None and len(attempt) != 16:
        raise WordError("BadForm", f"an attempt's id of {len(attempt)} bytes")
    return RelayFrame("" if writer == NOBODY else writer.hex(), "" if reader == NOBODY else reader.hex(), number, word)
