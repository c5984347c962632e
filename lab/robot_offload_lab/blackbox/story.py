"""Turns a part of a black box into a test: a pytest module with the box beside it. Also what such a test checks.

A test of this kind replays what one process took in. After the first decision that a fixed core makes differently the
recorded events no longer fit, so the test checks one thing only: that no rule is broken, that one wrong decision is not
repeated, or that all decisions are the expected ones.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Broke, Did, Header, Replayed, RuleBroken, Step
from robot_offload_core.words.decided import Decided
from robot_offload_lab.blackbox import ring
from robot_offload_lab.blackbox.decided import said

TEMPLATE = '''"""{title}

{meaning}
"""

from pathlib import Path

from robot_offload_lab.blackbox import story

BOX = Path(__file__).with_suffix(".box")
{data}

def test_{name}() -> None:
    assert story.steps(BOX) == {steps}, story.UNREADABLE
    {assertion}
'''


UNREADABLE = "the core's classes have changed: this core cannot read the box, so the test proves nothing any more"


class Asks(enum.Enum):
    """What a test checks: (text of its docstring, its assertion)."""

    NO_BROKEN_RULE = (
        """{steps} steps of {machines}. A step broke a rule of its machine: {what}.
The test fails while a step of the box breaks a rule.""",
        "assert story.broken_rules(BOX) == []",
    )
    NOT_AGAIN = (
        """{steps} steps of {machines}, up to a decision that was wrong: {what}.
The test fails while the core decides the same in that step.""",
        "assert WRONG not in story.decided_in_steps(BOX)",
    )
    AS_EXPECTED = (
        """{steps} steps of {machines}. Expected is what was decided on the robot: where that was wrong, write into
EXPECTED what would have been right, and drop what follows from there.""",
        "assert story.decided(BOX)[: len(EXPECTED)] == EXPECTED",
    )


@dataclass(frozen=True)
class Story:
    """A test: its module's text, and the lines of the box."""

    text: str
    lines: tuple[str, ...]
    asks: Asks


def made(name: str, title: str, lines: Sequence[str], wrong_at: str = "") -> Story:
    """Return a test of lines of a box.

    Args:
        name: of the test, an identifier.
        title: description of the part.
        lines: of the box.
        wrong_at: time of day of a wrong decision (HH:MM:SS.mmm, as the replay shows it), "" for none.

    Raises:
        LookupError: nothing was decided at `wrong_at`.
    """
    if wrong_at:
        return _not_again(name, title, lines, wrong_at)
    rules = _broken(lines)
    if rules:
        return _story(name, title, lines, Asks.NO_BROKEN_RULE, rules[0])
    expected = "".join(f"    {line!r},  # noqa: E501\n" for line in _decided(lines))
    return _story(name, title, lines, Asks.AS_EXPECTED, data=f"EXPECTED = [\n{expected}]\n")


def steps(box: Path) -> int:
    """Return how many steps of a box this core can read."""
    return len(_taken(ring.lines(box)))


def broken_rules(box: Path) -> list[str]:
    """Return the rules that steps of a box break when they are run again, each with its machine and event."""
    return _broken(ring.lines(box))


def decided_in_steps(box: Path) -> list[tuple[str, float, str]]:
    """Return all decisions of a replay: machine, time of the step (as in the box), decision without its message."""
    return [
        (step.machine.value, step.now_s, _short(decision))
        for step in blackbox.replay(ring.lines(box))
        if isinstance(step, Replayed)
        for decision in step.decided
    ]


def decided(box: Path) -> list[str]:
    """Return all decisions of a replay: seconds since the first step, machine, what was decided."""
    return _decided(ring.lines(box))


def _not_again(name: str, title: str, lines: Sequence[str], wrong_at: str) -> Story:
    for end, to_wall_s, did in _written(lines):
        chosen = next((one for one in did if isinstance(one.decision, Decided)), did[0])
        if wrong_at == ring.clock(chosen.now_s + to_wall_s):
            data = f"WRONG = {(chosen.machine.value, chosen.now_s, _short(chosen.decision))!r}  # noqa: E501\n"
            return _story(name, title, lines[:end], Asks.NOT_AGAIN, said(chosen.decision), data=data)
    raise LookupError(wrong_at)


def _written(lines: Sequence[str]) -> Iterator[tuple[int, float, list[Did]]]:
    """Yield what was decided in each step, with the number of lines so far and the clock's offset."""
    group: list[Did] = []
    to_wall_s = 0.0
    for at, line in enumerate([*lines, ""]):
        record = blackbox.parse(line)
        if isinstance(record, Did):
            group.append(record)
        elif group:
            yield at, to_wall_s, group
            group = []
        if isinstance(record, Header):
            to_wall_s = ring.offset_s(record, to_wall_s)


def _story(name: str, title: str, lines: Sequence[str], asks: Asks, what: str = "", data: str = "") -> Story:
    meaning, assertion = asks.value
    taken = _taken(lines)
    machines = " and ".join(sorted({one.machine.value for one in taken}))
    meaning = meaning.format(steps=len(taken), machines=machines, what=what)
    text = TEMPLATE.format(title=title, meaning=meaning, data=data, name=name, assertion=assertion, steps=len(taken))
    return Story(text, tuple(lines), asks)


def _taken(lines: Iterable[str]) -> list[Step | Broke]:
    return [one for line in lines if isinstance(one := blackbox.parse(line), Step | Broke)]


def _broken(lines: Iterable[str]) -> list[str]:
    return [
        f"{found.machine.value}: {type(found.event).__name__}: {found.rule}"
        for found in blackbox.replay(lines)
        if isinstance(found, RuleBroken)
    ]


def _decided(lines: Iterable[str]) -> list[str]:
    found: list[str] = []
    begin_s: float | None = None
    for step in blackbox.replay(lines):
        if isinstance(step, Replayed):
            begin_s = step.now_s if begin_s is None else begin_s
            found += [f"+{step.now_s - begin_s:.3f} {step.machine.value}: {said(one)}" for one in step.decided]
    return found


def _short(decision: Any) -> str:
    if isinstance(decision, Decided):
        return f"{decision.site.value} {decision.phase.value} {decision.verdict.reason.value}"
    return said(decision)
