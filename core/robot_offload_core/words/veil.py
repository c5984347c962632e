"""The veil over the robot's incarnation in all that the cloud says.

An incarnation is a bearer name: who knows the robot's could speak as the living robot with a copy of its key. A copy
may hear what the cloud says, and nobody but the cloud may hear the robot (access rules of the link). So the robot says
its incarnation, and the cloud names the robot by a hash of it, which the robot recognises and nobody can turn round.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

from robot_offload_core.fence.token import INCARNATION_LENGTH, Token
from robot_offload_core.words.replace import replace

_PREFIX = b"robot-offload veil 1 "


@lru_cache(maxsize=64)
def veiled(incarnation: str) -> str:
    """Return the hash by which the cloud names a robot, in the form of an incarnation; "" of ""."""
    if not incarnation:
        return ""
    return hashlib.sha256(_PREFIX + incarnation.encode()).hexdigest()[:INCARNATION_LENGTH]


def unveiled(name: str, own: str) -> str:
    """Return our own incarnation when a name is the hash of it, else the name: another robot's, or an older cloud's."""
    return own if own and name == veiled(own) else name


def veil_token(token: Token) -> Token:
    """Return a token as the cloud says it."""
    return replace(token, robot=veiled(token.robot))


def unveil_token(token: Token, own: str) -> Token:
    """Return a token of the cloud with our own incarnation for its hash."""
    name = unveiled(token.robot, own)
    return token if name == token.robot else replace(token, robot=name)
