"""The veil over the robot's incarnation in everything that the cloud sends.

An incarnation works like a bearer token: a holder of a copy of the robot's key who knows it could pose as the living
robot. The access rules of the link let such a copy hear the cloud, but only the cloud may hear the robot. So the robot
sends its incarnation, and the cloud names the robot by a hash of it, which the robot recognises and no one can reverse.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

from robot_offload_core.fence.token import INCARNATION_LENGTH, Token
from robot_offload_core.words.replace import replace

_PREFIX = b"robot-offload veil 1 "


@lru_cache(maxsize=64)
def veiled(incarnation: str) -> str:
    """Return the hash by which the cloud names a robot, in the form of an incarnation; "" for ""."""
    if not incarnation:
        return ""
    return hashlib.sha256(_PREFIX + incarnation.encode()).hexdigest()[:INCARNATION_LENGTH]


def unveiled(name: str, own: str) -> str:
    """Return our own incarnation if `name` is its hash, else `name`: another robot, or sent by an older cloud."""
    return own if own and name == veiled(own) else name


def veil_token(token: Token) -> Token:
    """Return a token as the cloud sends it."""
    return replace(token, robot=veiled(token.robot))


def unveil_token(token: Token, own: str) -> Token:
    """Return a token of the cloud with the hash of our own incarnation replaced by it."""
    name = unveiled(token.robot, own)
    return token if name == token.robot else replace(token, robot=name)
