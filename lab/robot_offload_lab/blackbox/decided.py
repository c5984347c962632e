"""The outcome of a replay of a black box."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Differs, Gap, Header, Replayed, RuleBroken
from robot_offload_core.words import codec
from robot_offload_lab.blackbox import ring

RULE_BROKEN = "RuleBroken"


@dataclass(frozen=True)
class DecidedMoment:
    """A decision of a replay, a rule that a step broke, or a difference from the recorded decision.

    Attributes:
        wall_s: system time of the robot, seconds.
        machine: which machine decided.
        event: the name of the event that it had taken in.
        name, decision: what it decided, as plain values; for a broken rule `RULE_BROKEN` and the rule.
        changed: field of the state -> (before, after).
        differs: what was recorded instead, None when it is the same.
    """

    wall_s: float
    machine: str
    event: str
    name: str
    decision: str
    changed: dict[str, tuple[str, str]] = field(default_factory=dict)
    differs: str | None = None


@dataclass
class Totals:
    """Figures of a replay: steps, decisions, broken rules, differences, missing lines and steps, files, other cores."""

    steps: int = 0
    decisions: int = 0
    rules_broken: int = 0
    differences: int = 0
    gaps: int = 0
    left_out: int = 0
    processes: set[str] = field(default_factory=set)
    other_cores: set[str] = field(default_factory=set)


def moments(lines: Iterable[str], totals: Totals) -> Iterator[DecidedMoment]:
    """Replay lines and yield what was decided; add to `totals` on the way."""
    to_wall_s, ours = 0.0, ring.digest_of_core()
    for found in blackbox.replay(lines):
        if isinstance(found, Header):
            to_wall_s = ring.offset_s(found, to_wall_s)
            totals.processes.add(str(found.facts.get("process", "")))
            core = str(found.facts.get("core", ""))
            totals.other_cores |= {core} - {ours, ""}
        elif isinstance(found, Gap):
            totals.gaps += 1
            totals.left_out += found.steps
        elif isinstance(found, Replayed):
            totals.steps += 1
            totals.decisions += len(found.decided)
            for decision in found.decided:
                yield DecidedMoment(
                    found.now_s + to_wall_s, found.machine.value, type(found.event).__name__,
                    type(decision).__name__, said(decision), changed(found.before, found.after),
                )  # fmt: skip
        elif isinstance(found, RuleBroken):
            totals.rules_broken += 1
            yield DecidedMoment(
                found.now_s + to_wall_s, found.machine.value, type(found.event).__name__, RULE_BROKEN, found.rule
            )
        else:
            totals.differences += 1
            yield _difference(found, to_wall_s)


def _difference(found: Differs, to_wall_s: float) -> DecidedMoment:
    names = {_kind(one) for one in (*found.written, *found.replayed)}
    states = changed(found.written[0], found.replayed[0]) if _is_state(found) else {}
    now = "; ".join(map(said, found.replayed)) or "nothing"
    then = "; ".join(map(said, found.written)) or "nothing"
    return DecidedMoment(
        found.now_s + to_wall_s, found.machine.value, "", "/".join(sorted(names)),
        "the state" if states else now, states, "another state" if states else then,
    )  # fmt: skip


def _is_state(found: Differs) -> bool:
    kind = blackbox.KINDS[found.machine].state
    return bool(found.written) and isinstance(found.written[0], kind)


def _kind(decision: Any) -> str:
    return RULE_BROKEN if isinstance(decision, str) else type(decision).__name__


def said(decision: Any) -> str:
    """Return a decision in words: its reason and message, else its fields; a broken rule is returned unchanged."""
    if isinstance(decision, str):
        return decision
    verdict = getattr(decision, "verdict", decision)
    reason, message = getattr(verdict, "reason", None), getattr(verdict, "message", None)
    if reason is None or message is None:
        return " ".join(f"{one.name}={_word(getattr(decision, one.name))}" for one in dataclasses.fields(decision))
    side = getattr(decision, "site", None)
    where = f"{_word(side)} epoch {decision.epoch} " if side is not None else ""
    return f"{where}{_word(reason)}: {message}"


def changed(before: Any, after: Any) -> dict[str, tuple[str, str]]:
    """Return the fields of a state that a step has changed."""
    pairs = ((one.name, getattr(before, one.name), getattr(after, one.name)) for one in dataclasses.fields(before))
    return {
        name: (_word(old), _word(new)) for name, old, new in pairs if old != new and name not in ("levels", "levels_s")
    }


def _word(value: Any) -> str:
    text = str(codec.plain(value))
    return text if len(text) <= 200 else text[:200] + "..."
