"""The shape of a configuration: what is numbered by its place, as one short digest, and what differs between two.

Beats carry ages of required inputs and bits of outputs by their places in the lists of the configuration. Two sides
whose lists differ, even in their order alone, would judge one topic by the figures of another.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from robot_offload_core.words.beats import SHAPE_LENGTH

Place = tuple[str, str]
"""Name and topic of what stands at a place."""


def shape(required: Iterable[Place], outputs: Iterable[Place]) -> str:
    """Return the digest of the required inputs and of the outputs, each in order: hexadecimal digits."""
    lines = [
        f"{kind} {name} {topic}" for kind, places in (("in", required), ("out", outputs)) for name, topic in places
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:SHAPE_LENGTH]
