"""The shape of a configuration: a short digest of everything that is numbered by its place.

Beats carry ages of required inputs and bits of outputs by their places in the lists of the configuration. If the lists
of the two sides differed, even in order alone, one topic would be judged by the figures of another.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from robot_offload_core.words.beats import SHAPE_LENGTH

Place = tuple[str, str]
"""Name and topic of the entry at a place."""


def shape(required: Iterable[Place], outputs: Iterable[Place]) -> str:
    """Return the digest of the required inputs and the outputs, each in order, as hexadecimal digits."""
    lines = [
        f"{kind} {name} {topic}" for kind, places in (("in", required), ("out", outputs)) for name, topic in places
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:SHAPE_LENGTH]
