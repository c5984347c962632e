"""Goals and calls: what their client felt of the relay and of each move of the execution.

* acceptance: from sending a goal until its answer, one goal after the other;
* call: from calling a service until its answer; *added* is its distance to the direct path's median of the same run;
* gap: the longest time between two feedback messages, or the last one and the result, of one goal of those that were
  alive when something happened;
* faults: goals whose client did not get exactly one result, SUCCEEDED.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from robot_offload_lab.bench.observed import CallAnswered, GoalAnswered, GoalEnded, GoalFeedback, Observation, only
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import (
    Distribution,
    Figure,
    GroupResult,
    Priority,
    at_or_none,
    part,
    parts,
)

GROUP: Final = "handover"
MIRRORED: Final = "mirrored"
MIRROR_MUST_MS: Final = 60.0
MIRROR_AIM_MS: Final = 30.0
"""Beyond a period of the rated output whose silence is the loss."""
SUCCEEDED: Final = 4
WORDS: Final = {"commanded": "a commanded switch", "cut": "a sudden cut", "killed": "the end of the robot's relay"}
PATHS: Final = {"direct": "direct", "robot": "the robot holds", "cloud": "the cloud holds"}


@dataclass(frozen=True)
class Phase:
    """A stretch in which goals and calls came one after the other: `name` is `direct` or the side that held."""

    name: str
    prefix: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Moment:
    """Something that happened at `at_s` to goals that began after `begin_s` and ended before `end_s`."""

    kind: str
    begin_s: float
    at_s: float
    end_s: float


@dataclass(frozen=True)
class HandoverAccount:
    """A run. `loss_ms`: `lossTimeout`. `link_ms`: a round trip of the link's own delay."""

    phases: tuple[Phase, ...]
    moments: tuple[Moment, ...]
    observations: tuple[Observation, ...]
    loss_ms: float
    link_ms: float


def accepted_ms(account: HandoverAccount, name: str) -> list[float]:
    """Return how long goals waited for their answer in a phase."""
    phase = next(p for p in account.phases if p.name == name)
    goals = only(GoalAnswered, account.observations)
    return [(g.t_s - g.asked_s) * 1e3 for g in goals if phase.begin_s <= g.asked_s <= phase.end_s]


def called_ms(account: HandoverAccount, name: str) -> list[float]:
    """Return how long calls waited for their answer in a phase."""
    phase = next(p for p in account.phases if p.name == name)
    calls = only(CallAnswered, account.observations)
    return [(c.t_s - c.asked_s) * 1e3 for c in calls if phase.begin_s <= c.asked_s <= phase.end_s]


def gaps_ms(account: HandoverAccount, kind: str) -> list[float]:
    """Return the longest gap of each goal to which something of that kind happened."""
    feedback: dict[int, list[float]] = {}
    for heard in only(GoalFeedback, account.observations):
        feedback.setdefault(heard.goal, []).append(heard.t_s)
    for end in only(GoalEnded, account.observations):
        feedback.setdefault(end.goal, []).append(end.t_s)  # feedback that never came again is a gap until the result
    found = []
    for moment in account.moments:
        if moment.kind != kind:
            continue
        for goal in _alive(account, moment):
            times = feedback.get(goal.goal, [])
            found.append(max(((b - a) * 1e3 for a, b in itertools.pairwise(times)), default=float("inf")))
    return found


def _alive(account: HandoverAccount, moment: Moment) -> list[GoalAnswered]:
    goals = only(GoalAnswered, account.observations)
    return [g for g in goals if moment.begin_s <= g.asked_s <= moment.at_s]


def faults(account: HandoverAccount) -> tuple[int, dict[str, int]]:
    """Return how many goals were alive when something happened, and how many of them did not end as they should."""
    ends = Counter(end.goal for end in only(GoalEnded, account.observations))
    wrong = {end.goal for end in only(GoalEnded, account.observations) if end.status != SUCCEEDED}
    goals = [goal for moment in account.moments for goal in _alive(account, moment)]
    return len(goals), {
        "lost": sum(ends[g.goal] == 0 for g in goals),
        "doubled": sum(ends[g.goal] > 1 for g in goals),
        "wrong": sum(g.goal in wrong or not g.accepted for g in goals),
    }


def outcome(group: str, case: BenchCase, priority: Priority, account: HandoverAccount) -> GroupResult:
    """Return the figures of a run: of a group, because it is measured idle and with load."""
    return GroupResult(
        group, priority, tuple(_figures(case, account)), parts(_parts(account)), tuple(_samples(account))
    )


def mirrored(case: BenchCase, priority: Priority, account: HandoverAccount) -> GroupResult:
    """Return the figures of a run of cuts in which both sides execute each goal."""
    gaps = gaps_ms(account, "cut")
    gap = Figure(
        "gap_cut", "Feedback gap of a mirrored goal at a sudden cut, Hot, p99", case.describe(), case.tolerance_ms,
        len(gaps), at_or_none(gaps, 0.99), "ms", case.robot_period_ms + MIRROR_MUST_MS,
        case.robot_period_ms + MIRROR_AIM_MS, note=f"a message each 20 ms; median {at_or_none(gaps, 0.5) or 0:.0f} ms",
    )  # fmt: skip
    samples = tuple({"what": "gap cut", "number": n, "ms": round(ms, 3)} for n, ms in enumerate(gaps, start=1))
    distribution = part("longest feedback gap at a sudden cut, mirrored", "ms", gaps)
    return GroupResult(MIRRORED, priority, (_faults(case, account), gap), parts([distribution]), samples)


def _faults(case: BenchCase, account: HandoverAccount) -> Figure:
    count, found = faults(account)
    note = ", ".join(f"{number} {name}" for name, number in found.items())
    what = " and ".join(WORDS[kind] for kind in dict.fromkeys(moment.kind for moment in account.moments))
    return Figure(
        "faults", "Goals lost, doubled or with a wrong result", case.describe(), case.tolerance_ms, count,
        sum(found.values()), "messages", 0, 0, note=f"{note} of {count} goals through {what}",
    )  # fmt: skip


def _figures(case: BenchCase, account: HandoverAccount) -> Iterator[Figure]:
    where = case.describe(), case.tolerance_ms
    yield _faults(case, account)
    for name in ("robot", "cloud"):
        times = accepted_ms(account, name)
        yield Figure(
            f"accepted_{name}", f"Goal accepted, {PATHS[name]}, p99", *where, len(times), at_or_none(times, 0.99),
            "ms", 20, 8, baseline=at_or_none(accepted_ms(account, "direct"), 0.99), against="the server itself",
        )  # fmt: skip
    limits = {"commanded": (80.0, 30.0), "cut": (account.loss_ms + 150, account.loss_ms + 60), "killed": (None, None)}
    for kind, (must, aim) in limits.items():
        gaps = gaps_ms(account, kind)
        yield Figure(
            f"gap_{kind}", f"Feedback gap of a goal at {WORDS[kind]}, p99", *where, len(gaps), at_or_none(gaps, 0.99),
            "ms", must, aim, note=f"a message each 20 ms; median {at_or_none(gaps, 0.5) or 0:.0f} ms",
        )  # fmt: skip
    yield from _calls(where, account)


def _calls(where: tuple[str, int], account: HandoverAccount) -> Iterator[Figure]:
    direct = called_ms(account, "direct")
    middle = at_or_none(direct, 0.5) or 0.0
    limits = {"robot": (0.0, (2, 6), (1, 3)), "cloud": (account.link_ms, (4, 12), (2.5, 6))}
    for name, (link_ms, must, aim) in limits.items():
        added = [time - middle for time in called_ms(account, name)]
        for index, (share, word) in enumerate(((0.5, "p50"), (0.99, "p99"))):
            yield Figure(
                f"call_{name}_{word}", f"Added to a service call, {PATHS[name]}, {word}", *where,
                len(added), at_or_none(added, share), "ms", link_ms + must[index], link_ms + aim[index],
                note=f"a direct call takes {middle:.1f} ms (p50)",
            )  # fmt: skip


def _parts(account: HandoverAccount) -> Iterator[Distribution | None]:
    for name, words in PATHS.items():
        yield part(f"goal sent until accepted, {words}", "ms", accepted_ms(account, name))
        yield part(f"call until answered, {words}", "ms", called_ms(account, name))
    for kind, words in WORDS.items():
        yield part(f"longest feedback gap at {words}", "ms", gaps_ms(account, kind))


def _samples(account: HandoverAccount) -> Iterator[dict[str, Any]]:
    values: Sequence[tuple[str, Sequence[float]]] = (
        *((f"accepted {name}", accepted_ms(account, name)) for name in PATHS),
        *((f"called {name}", called_ms(account, name)) for name in PATHS),
        *((f"gap {kind}", gaps_ms(account, kind)) for kind in WORDS),
    )
    for name, found in values:
        for number, value in enumerate(found, start=1):
            yield {"what": name, "number": number, "ms": round(value, 3)}
