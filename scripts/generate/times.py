"""The reference page of the protocol's fixed times: every constant of the core that is a time, from its source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CORE: Final = Path(__file__).parents[2] / "core" / "robot_offload_core"
SUFFIXES: Final = ("_S", "_PER_S")
"""Names of times end in the first and not in the second, which is a rate."""
_HEAD: Final = """\
<!-- Generated from the constants in core/ by `make generate`; changes here are lost. -->
# Times of the protocol

What a user may set (heartbeat, `lossTimeout`, `lease`, deadlines) is in [the resource](robotoffload.md). The times here
are fixed.
Each belongs to one room of the core, which is named by its process ([architecture](../architecture.md)).
"""


@dataclass(frozen=True)
class FixedTime:
    """One constant: its room, its name, its value as written, and what its docstring states."""

    room: str
    name: str
    value: str
    text: str


class UndocumentedTimeError(ValueError):
    """A time of the core has no docstring, so that no reader can know what it bounds."""


def times() -> str:
    """Return the page's text.

    Raises:
        UndocumentedTimeError: a constant has no docstring; the message names it.
    """
    found = [time for file in sorted(CORE.rglob("*.py")) for time in _times_of(file)]
    lines = [_HEAD]
    for room in sorted({time.room for time in found}):
        lines += [f"## {room}\n", "| constant | seconds | what it bounds |", "|---|---|---|"]
        lines += [f"| `{time.name}` | {time.value} | {time.text} |" for time in found if time.room == room]
        lines.append("")
    return "\n".join(lines)


def _times_of(file: Path) -> Iterator[FixedTime]:
    """Yield the times among the module's constants whose value is a number."""
    room = file.relative_to(CORE).parts[0]
    body = ast.parse(file.read_text(encoding="utf-8")).body
    for statement, following in zip(body, [*body[1:], None], strict=True):
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Constant(value=int() | float() as value)):
                pass
            case _:
                continue
        if not name.endswith(SUFFIXES[0]) or name.endswith(SUFFIXES[1]):
            continue
        match following:
            case ast.Expr(value=ast.Constant(value=str() as text)):
                yield FixedTime(room, name, f"{value:g}", " ".join(text.split()))
            case _:
                raise UndocumentedTimeError(f"{file.relative_to(CORE)}: write what {name} bounds, below it")
