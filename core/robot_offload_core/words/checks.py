"""What must hold after every step of a machine, checked in production too: a state that breaks it is never acted on."""

from __future__ import annotations

BROKEN_EXIT = 70
"""Exit code of a process that ended for an InvariantError (EX_SOFTWARE of sysexits.h)."""


class InvariantError(Exception):
    """A machine reached a state that it must never be in: a defect, not an input. The process ends and starts anew.

    Attributes:
        machine: name of the machine.
        rule: what does not hold.
        event: what led there.
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
