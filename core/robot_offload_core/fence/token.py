"""Which side may act: sites, incarnations and the token (protocol section 1)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

INCARNATION_LENGTH = 32
"""Hexadecimal digits of an incarnation: 128 random bits drawn at each start of a side's control process."""


class Site(str, Enum):
    """The two sides; these words are used everywhere."""

    ROBOT = "robot"
    CLOUD = "cloud"

    @property
    def other(self) -> Site:
        """The opposite side."""
        return Site.CLOUD if self is Site.ROBOT else Site.ROBOT


@dataclass(frozen=True, order=False)
class Token:
    """Names one stay in charge. A token equals ours or is foreign; "newer" is never accepted in place of equal.

    Attributes:
        robot: incarnation of the robot's control process (32 hexadecimal digits).
        epoch: grows by one with every changeover that this incarnation tries; 0 in the token of `presence`.
        cloud: incarnation of the cloud's control process.
    """

    robot: str
    epoch: int
    cloud: str


def presence(robot: str, cloud: str) -> Token:
    """Return the token of nodes with placement Cloud, valid whichever side is in charge; no stay has epoch 0."""
    return Token(robot, 0, cloud)


def is_incarnation(text: str) -> bool:
    """Return whether `text` has the form of an incarnation."""
    return len(text) == INCARNATION_LENGTH and all(c in "0123456789abcdef" for c in text)
