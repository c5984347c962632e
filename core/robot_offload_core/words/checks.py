"""Invariants, checked after every step of a machine in production too: a state that breaks one is never used."""

from __future__ import annotations

BROKEN_EXIT = 70
"""Exit code of a process that ended for an InvariantError (EX_SOFTWARE of sysexits.h)."""


class InvariantError(Exception):
    """A machine reached a forbidden state: a defect, not a bad input. The process ends and is restarted.

    Attributes:
        machine: name of the machine.
        rule: the broken rule, in words.
        event: the event of the step.
    """

    def __init__(self, machine: str, rule: str, event: object) -> None:
        super().__init__(f"{machine}: {rule}; after {event!r}")
        self.machine, self.rule, self.event = machine, rule, event


def rule_of(error: InvariantError | AssertionError) -> str:
    """Return which rule was broken, in words."""
    return error.rule if isinstance(error, InvariantError) else str(error) or "an assertion of the core"


def require(machine: str, event: object, *rules: tuple[bool, str]) -> None:
    """Raise InvariantError with the first of `rules` (holds, what does not hold) that is broken."""
    for holds, rule in rules:
        if not holds:
            raise InvariantError(machine, rule, event)
