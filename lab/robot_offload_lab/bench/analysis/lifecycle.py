"""Activation and deactivation of lifecycle nodes as their manager sees them: from the asking to the answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts

GROUP: Final = "lifecycle"
TRANSITIONS: Final = {"activate": "activation", "deactivate": "deactivation"}
BASELINE: Final = "alone"


@dataclass(frozen=True)
class TransitionCase:
    """One situation in which nodes are activated and deactivated.

    Attributes:
        name: a word.
        title: for people.
        thesis: what the thesis measured in the situation that is nearest to it; empty when it had none.
    """

    name: str
    title: str
    thesis: str = ""


@dataclass(frozen=True)
class Rounds:
    """What the manager found in a case; times in milliseconds, a list of answers for each round.

    Attributes:
        answers: by transition (`activate`, `deactivate`).
        refused: transitions that a node did not make.
        unanswered: transitions of which no answer came; each was asked for once.
    """

    case: TransitionCase
    answers: Mapping[str, Sequence[Sequence[float]]]
    refused: int
    unanswered: int

    @classmethod
    def from_json(cls, case: TransitionCase, said: Mapping[str, Any]) -> Rounds:
        """Return the rounds from the manager's lines."""
        return cls(case, {word: said[word] for word in TRANSITIONS}, said["refused"], said["unanswered"])

    def each(self, transition: str) -> tuple[float, ...]:
        """Return the times of single nodes."""
        return tuple(value for answers in self.answers[transition] for value in answers)

    def whole(self, transition: str) -> tuple[float, ...]:
        """Return the times of all nodes of a round together: those of the last answers."""
        return tuple(max(answers) for answers in self.answers[transition] if answers)

    @property
    def several(self) -> bool:
        """Whether more than one node is asked at once."""
        return any(len(answers) > 1 for found in self.answers.values() for answers in found)


_FIRST_ANSWER = "asked once each; DDS loses an answer to somebody not discovered yet; the agents ask again"


def outcome(priority: Priority, found: Sequence[Rounds], refused: Mapping[str, str]) -> GroupResult:
    """Return the figures of all cases.

    Args:
        priority: of the nodes.
        found: what was measured.
        refused: title of a case -> why it could not run on this machine.
    """
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(*_figures(found), *(_missing(title, why) for title, why in refused.items())),
        parts=parts(_parts(found)),
        samples=tuple(_samples(found)),
    )


def _figures(found: Sequence[Rounds]) -> Iterator[Figure]:
    base = next((rounds for rounds in found if rounds.case.name == BASELINE), None)
    for rounds in found:
        for transition, word in TRANSITIONS.items():
            values = rounds.whole(transition)
            beside = None if base is None or rounds is base else at_or_none(base.whole(transition), 0.5)
            yield Figure(
                f"{rounds.case.name}_{transition}_p50", f"{word.capitalize()}, p50", rounds.case.title, None,
                len(values), at_or_none(values, 0.5), "ms", note=_note(rounds, values), baseline=beside,
                against="" if beside is None else "a node alone",
            )  # fmt: skip
    count = sum(len(rounds.each(transition)) for rounds in found for transition in TRANSITIONS)
    refused = sum(rounds.refused for rounds in found)
    yield Figure("refused", "Transitions refused", "all cases", None, count, refused, "messages", 0)
    unanswered = sum(rounds.unanswered for rounds in found)
    yield Figure(
        "unanswered", "Transitions without an answer", "all cases", None, count + unanswered, unanswered, "messages",
        note=_FIRST_ANSWER,
    )  # fmt: skip


def _note(rounds: Rounds, values: Sequence[float]) -> str:
    high = at_or_none(values, 0.99)
    words = [] if high is None else [f"p99 {high:.1f} ms"]
    if rounds.several:
        words.append("until the last has answered")
    if rounds.case.thesis:
        words.append(f"thesis: {rounds.case.thesis}")
    return "; ".join(words)


def _missing(title: str, why: str) -> Figure:
    return Figure(f"missing_{title}", "Activation and deactivation", title, None, 0, None, "ms", note=f"not run: {why}")


def _parts(found: Sequence[Rounds]) -> Iterator[Distribution | None]:
    for rounds in found:
        for transition, word in TRANSITIONS.items():
            yield part(f"{rounds.case.title}: {word} of a node", "ms", rounds.each(transition))
            if rounds.several:
                yield part(f"{rounds.case.title}: {word} of all", "ms", rounds.whole(transition))


def _samples(found: Sequence[Rounds]) -> Iterator[Sample]:
    for rounds in found:
        for transition, word in TRANSITIONS.items():
            for number, answers in enumerate(rounds.answers[transition], start=1):
                for value in answers:
                    yield {
                        "case": rounds.case.name, "series": f"{rounds.case.title}, {word}", "round": number,
                        "ms": round(value, 4),
                    }  # fmt: skip
