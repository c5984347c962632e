"""One parameter of the agent: default, unit, range, meaning."""

from __future__ import annotations

from dataclasses import dataclass

Value = str | bool | int | float | list[str]


TOPIC = r"/[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*"
CALLED = r"[A-Za-z0-9_]+"
"""Form of identifiers, which become parts of parameters' names."""


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        default: its type is the parameter's type. None: it must be given; then `kind` states the type.
        text: meaning, with unit.
        low, high: inclusive range of numbers.
        choices: the only values of a text.
        pattern: regular expression that a text matches as a whole.
    """

    default: Value | None
    text: str
    kind: type = str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    pattern: str = ""

    @property
    def type(self) -> type:
        """The Python type of its values."""
        return self.kind if self.default is None else type(self.default)
