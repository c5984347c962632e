"""The probe: ten times a second each data process sends the other a sign of life or a list of what it holds.

A sign of life is a hundred bytes, so it fits one datagram however large the graph is. A whole probe, with all that this
side holds, is sent until the other side acknowledges it (by its digest), and once a second. Everything is a level, so a
lost message does no harm. JSON, because it is small, rare and grows.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, field

from robot_offload_core.fence.token import is_incarnation
from robot_offload_core.words.replace import replace

PROBE_PERIOD_S = 0.1
"""Ten probes a second, each way."""
VERSION = 2


MAX_BYTES = 150_000
"""Longer ones are not valid; control gets the notes in one datagram."""
MAX_ENTRIES = 1024
MAX_NAME = 256
"""Characters of a name, a hash, a type or a state."""
MAX_WORD = 2048
INTERFACE = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*( [A-Za-z0-9_]{1,100})?")
HASH = re.compile(r"[A-Za-z0-9_]{1,100}")


class ProbeError(ValueError):
    """The bytes are not a valid probe; `reason`: BadForm or OtherVersion."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


@dataclass(frozen=True)
class Sign:
    """A sign of life.

    Attributes:
        incarnation: of the sender's control process.
        digest: of the sender's present whole probe.
        held: digest of the newest whole probe that the sender has received from the other side; "" for none.
    """

    incarnation: str
    digest: str = ""
    held: str = ""


@dataclass(frozen=True)
class Probe:
    """A whole probe.

    Attributes:
        incarnation: of the sender's control process; pulse and data must show the same one.
        latched: hash of the sender's last values of each latched input.
        types: interface type of each input and output that the sender knows, then a blank and its hash if known.
        nodes: lifecycle state of each managed node of the sender.
        word: a request to the robot's control process, or its answer; "" for none.
        notes: of the sender's control process (notes.py); "" for none.
        preparing: epoch under which the sender gets ready; 0 while it does not.
        lacks: why the sender does not know a state of the active side, by the state's name.
        digest, held: see Sign.
        hashes: hashes of input types, by name, from the robot; separate, because an older cloud reads only names.
    """

    incarnation: str
    latched: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    nodes: dict[str, str] = field(default_factory=dict)
    word: str = ""
    notes: str = ""
    digest: str = ""
    held: str = ""
    preparing: int = 0
    lacks: dict[str, str] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)

    def type_of(self, name: str) -> str:
        """Return the type of an input or output, then a blank and its hash if known; "" if the type is unknown."""
        return " ".join(filter(None, (self.types.get(name, ""), self.hashes.get(name, ""))))


def encode(sent: Probe | Sign) -> bytes:
    """Encode a whole probe or a sign of life."""
    body: dict[str, object] = {"v": VERSION, "i": sent.incarnation, "d": sent.digest, "h": sent.held}
    if isinstance(sent, Probe):
        body |= {"l": sent.latched, "t": sent.types, "n": sent.nodes, "w": sent.word, "s": sent.notes}
        body |= {"p": sent.preparing, "a": sent.lacks}
        body |= {"y": sent.hashes} if sent.hashes else {}
    return json.dumps(body, separators=(",", ":")).encode()


def signed(probe: Probe, held: str) -> Probe:
    """Return the probe with its digest, and with the digest of the newest probe received from the other side."""
    bare = replace(probe, digest="", held="")
    return replace(probe, digest=digest([encode(bare)]), held=held)


def decode(data: bytes) -> Probe | Sign:
    """Decode a probe or a sign of life; raise ProbeError for anything else."""
    try:
        body = json.loads(data) if len(data) <= MAX_BYTES else None
    except (ValueError, RecursionError) as error:
        raise ProbeError("BadForm", f"not a probe: {error}") from error
    if not isinstance(body, dict):
        raise ProbeError("BadForm", "not a probe")
    if body.get("v") != VERSION:
        raise ProbeError("OtherVersion", f"version {body.get('v')!r:.20}, this side speaks {VERSION}")
    incarnation = _text(body.get("i"), 32)
    if incarnation and not is_incarnation(incarnation):
        raise ProbeError("BadForm", "an incarnation has 32 hexadecimal digits")
    sign = Sign(incarnation, _text(body.get("d"), MAX_NAME), _text(body.get("h"), MAX_NAME))
    if "l" not in body:
        return sign
    types = _table(body.get("t"))
    if not all(map(INTERFACE.fullmatch, types.values())):
        raise ProbeError("BadForm", "an interface type has another form")
    word, notes = _text(body.get("w"), MAX_WORD), _text(body.get("s", ""), MAX_BYTES)
    latched, nodes = _table(body.get("l")), _table(body.get("n"))
    preparing = body.get("p", 0)
    if type(preparing) is not int or preparing < 0:
        raise ProbeError("BadForm", f"{preparing!r:.40} is no epoch")
    lacks, hashes = _table(body.get("a", {})), _table(body.get("y", {}))
    if not all(map(HASH.fullmatch, hashes.values())):
        raise ProbeError("BadForm", "the hash of an interface type has another form")
    return Probe(incarnation, latched, types, nodes, word, notes, sign.digest, sign.held, preparing, lacks, hashes)


def _text(value: object, limit: int) -> str:
    if not isinstance(value, str) or len(value) > limit:
        raise ProbeError("BadForm", f"{value!r:.40} is no text of up to {limit} characters")
    return value


def _table(value: object) -> dict[str, str]:
    if not isinstance(value, dict) or len(value) > MAX_ENTRIES:
        raise ProbeError("BadForm", f"{value!r:.40} is no table of up to {MAX_ENTRIES} entries")
    return {_text(key, MAX_NAME): _text(text, MAX_NAME) for key, text in value.items()}


def digest(values: list[bytes]) -> str:
    """Return the hash of a latched topic's kept values, in order."""
    total = hashlib.sha256()
    for value in values:
        total.update(len(value).to_bytes(8, "big") + value)
    return total.hexdigest()[:16]
