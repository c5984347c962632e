"""A decision with its reason: what every check returns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

FOR_PEOPLE: Final = frozenset(
    {"NameTaken", "CannotRender", "Invalid", "Forbidden", "BuildFailed", "BuildsDisabled", "SecretType", "PodsRefused"}
)
"""Reasons that last until a person changes something: the specification, a right, an object that is in the way."""
Truth: TypeAlias = Literal["True", "False", "Unknown"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """A truth value, and why.

    Attributes:
        truth: True, False or Unknown, as in a condition.
        reason: one CamelCase word.
        message: a sentence, with the next step if there is one.
    """

    truth: Truth
    reason: str
    message: str = ""

    @property
    def holds(self) -> bool:
        """Whether it is true."""
        return self.truth == "True"


def yes(reason: str, message: str = "") -> Verdict:
    """Return True as a verdict."""
    return Verdict("True", reason, message)


def no(reason: str, message: str) -> Verdict:
    """Return False as a verdict; the message names the next step."""
    return Verdict("False", reason, message)


def unknown(reason: str, message: str) -> Verdict:
    """Return Unknown as a verdict."""
    return Verdict("Unknown", reason, message)


def gravest(verdicts: Iterable[Verdict]) -> Verdict | None:
    """Return the first verdict that waits for a person, or else the first one; None: there are none."""
    found = list(verdicts)
    return next((verdict for verdict in found if verdict.reason in FOR_PEOPLE), found[0] if found else None)
