"""Goal ids inside serialized messages: 16 bytes behind the 4 of the encapsulation, in requests and in feedback."""

from __future__ import annotations

import hashlib

GOAL_ID = slice(4, 20)
NO_GOAL = bytes(16)
"""In a cancel request: no goal in particular."""


def goal_id_of(payload: bytes) -> bytes | None:
    """Return the goal id of a SendGoal request or a feedback message; None when it is too short for one."""
    return bytes(payload[GOAL_ID]) if len(payload) >= GOAL_ID.stop else None


def with_goal_id(payload: bytes, goal_id: bytes) -> bytes:
    """Return the message with another goal id; nothing else is read."""
    return payload[: GOAL_ID.start] + goal_id + payload[GOAL_ID.stop :]


def attempt_id(incarnation: str, number: int) -> bytes:
    """Return the goal id of attempt `number` of a relay: a server takes an id only once, so each attempt has its own.

    Two relays never make the same one, their incarnations are 128 random bits.
    """
    return hashlib.sha256(f"{incarnation} {number}".encode()).digest()[:16]
