"""The probe: ten times a second each data process tells the other that the data session lives, and what it holds.

Everything in it is a level, so a lost probe loses nothing. JSON, because it is small, rare and grows.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field

PERIOD_S = 0.1
VERSION = 1


class ProbeError(ValueError):
    """Bytes that are no probe of ours."""


@dataclass(frozen=True)
class Probe:
    """One probe.

    Attributes:
        incarnation: of the sender's control process; pulse and data must show the same one.
        latched: hash of the last values of each latched input that the sender holds.
        types: interface type of each input and output that the sender knows.
        nodes: lifecycle state of each managed node of the sender.
        word: a request to, or an answer of, the robot's control process; "" for none.
        notes: of the sender's control process (notes.py); "" for none.
    """

    incarnation: str
    latched: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    nodes: dict[str, str] = field(default_factory=dict)
    word: str = ""
    notes: str = ""


def encode(probe: Probe) -> bytes:
    """The probe's bytes."""
    body = {
        "v": VERSION,
        "i": probe.incarnation,
        "l": probe.latched,
        "t": probe.types,
        "n": probe.nodes,
        "w": probe.word,
        "s": probe.notes,
    }
    return json.dumps(body, separators=(",", ":")).encode()


def decode(data: bytes) -> Probe:
    """Reads a probe; raises ProbeError."""
    try:
        body = json.loads(data)
        if body["v"] != VERSION:
            raise ProbeError(f"version {body['v']!r}, this side speaks {VERSION}")
        tables = [body["l"], body["t"], body["n"]]
    except (ValueError, KeyError, TypeError) as error:
        raise ProbeError(f"not a probe: {error}") from error
    if (
        not isinstance(body.get("i"), str)
        or not isinstance(body.get("w"), str)
        or not isinstance(body.get("s", ""), str)
        or not all(isinstance(t, dict) and all(isinstance(v, str) for v in t.values()) for t in tables)
    ):
        raise ProbeError("a probe's fields have other types")
    latched, types, nodes = tables
    return Probe(body["i"], latched, types, nodes, body["w"], body.get("s", ""))


def digest(values: list[bytes]) -> str:
    """Hash of a latched topic's kept values, in order."""
    total = hashlib.sha256()
    for value in values:
        total.update(len(value).to_bytes(8, "big") + value)
    return total.hexdigest()[:16]
