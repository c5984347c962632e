"""The header that the fence judges a message by, where everything else takes it from."""

from __future__ import annotations

from robot_offload_core.fence.envelope import (
    ABSENT,
    LATCHED,
    LAYOUT,
    MAGIC,
    Envelope,
    EnvelopeError,
    decode,
    encode,
)

__all__ = ["ABSENT", "LATCHED", "LAYOUT", "MAGIC", "Envelope", "EnvelopeError", "decode", "encode"]
