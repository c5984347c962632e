"""Goals, calls and state in a run: figures, and the promises about them. Pure.

* `GoalLost`: a goal that its client did not cancel succeeds. Not judged where one side was left out on purpose: then
  no replica can continue it.
* `GoalTwice`: a goal has one result.
* `GoalBackwards`: feedback only goes forward.
* `GoalGap`: feedback is silent no longer than an output may be, not counting time in which the driver was inhibited.
* `CallLost`: each call of a service is answered.
* `StateLost`: after a switch the side that takes over begins with the state of the other side, if a node there has
  reported that it acted: a side that never acted has none. A loss and a robot that cannot act do not wait for state, so
  recent state may still be on its way then.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_core.data.states import SNAPSHOT_RESEND_S
from robot_offload_core.words.reasons import Kind, Reason
from robot_offload_lab.judge.recording import Arrival, Calls, Errand, PathPoint, PlacementChange, Recording, Restored

SUCCEEDED: Final = "succeeded"
ON_THE_WAY: Final = "on the way"
ONE_SIDED: Final = "cloud-only"
"""The mode in which the robot has no replicas."""


@dataclass(frozen=True)
class GoalFigures:
    """One goal.

    Attributes:
        goal: its number.
        first, last: the first and the last report about it.
        until_s: when it ended, or was last reported, steady clock.
        silence_ms: longest silence of its feedback within the run.
        silent_s: when that silence was reported, steady clock.
        error_m: largest distance between the position estimated by the acting replica and the robot's true one; None:
            not reported.
    """

    goal: int
    first: Errand
    last: Errand
    until_s: float
    silence_ms: float
    silent_s: float
    error_m: float | None

    @property
    def ending(self) -> str:
        """How it ended, or that it is under way."""
        return self.last.ending or ON_THE_WAY

    @property
    def restarts(self) -> int:
        """How often another replica continued it."""
        return max(0, self.last.servers - 1)


@dataclass(frozen=True)
class Taking:
    """A switch, and the state with which the side that took over began."""

    change: PlacementChange
    restored: Restored


def goals(recording: Recording) -> tuple[GoalFigures, ...]:
    """Return the figures of each goal, in the order of their numbers."""
    by_goal: dict[int, list[Errand]] = {}
    for errand in recording.goals:
        if errand.t_s <= recording.end_s or errand.ending:
            by_goal.setdefault(errand.goal, []).append(errand)
    return tuple(_figures(recording, number, said) for number, said in sorted(by_goal.items()))


def _figures(recording: Recording, number: int, said: Sequence[Errand]) -> GoalFigures:
    silent = max(said, key=lambda errand: errand.silence_ms)
    errors = [error for errand in said if (error := _error_m(recording.path, errand)) is not None]
    until_s = next((errand.t_s for errand in said if errand.ending), said[-1].t_s)
    return GoalFigures(number, said[0], said[-1], until_s, silent.silence_ms, silent.t_s, max(errors, default=None))


def _error_m(path: Sequence[PathPoint], errand: Errand) -> float | None:
    """Return the distance in metres between the estimated and the true position near that time."""
    if errand.x_m is None or errand.y_m is None or errand.ending:
        return None
    near = [point for point in path if abs(point.t_s - errand.t_s) <= 0.2]
    return min((math.dist((errand.x_m, errand.y_m), (point.x_m, point.y_m)) for point in near), default=None)


def calls(recording: Recording) -> Calls | None:
    """Return the last report about calls; None: there are none."""
    return recording.calls[-1] if recording.calls else None


def takings(recording: Recording) -> tuple[Taking, ...]:
    """Return the state with which each side that took over began, if a node reports it before the next switch.

    A report that a node sent while its side was still getting ready may arrive after the switch. It does not count for
    the stay: the node may have received the state since.
    """
    found = []
    changes = [change for change in recording.placements if change.t_s <= recording.end_s]
    switches = [after for before, after in itertools.pairwise(changes) if before.site != after.site]
    for index, change in enumerate(switches):
        end_s = switches[index + 1].t_s if index + 1 < len(switches) else math.inf
        passed_s = _passed_s(recording, change, switches[index - 1].t_s if index else -math.inf)
        said = (it for it in recording.restored if it.site == change.site and it.t_s < end_s)
        witness = next((it for it in said if _begun_s(it, change) >= passed_s), None)
        found += [Taking(change, witness)] if witness is not None else []
    return tuple(found)


def _begun_s(restored: Restored, change: PlacementChange) -> float:
    """Return when a report was made; one without a time counts as made in the stay in which it was received."""
    if restored.made_s is not None:
        return restored.made_s
    return restored.t_s + _ANNOUNCED_S if restored.t_s < change.t_s else restored.t_s


def _passed_s(recording: Recording, change: PlacementChange, last_s: float) -> float:
    """Return when a side's first message passed in a stay; the announcement comes a little before or after it.

    Args:
        recording: of the run.
        change: the announcement.
        last_s: the switch before, steady clock.
    """
    early_s = max(change.t_s - _ANNOUNCED_S, last_s)
    first = [change.t_s]
    for arrivals in recording.outputs.values():
        window = slice(*(bisect_left(arrivals, t_s, key=_arrived_s) for t_s in (early_s, change.t_s)))
        first += [min(it.t_s, it.passed_t_s or it.t_s) for it in arrivals[window] if it.site == change.site]
    return min(first)


def _arrived_s(arrival: Arrival) -> float:
    return arrival.t_s


_ANNOUNCED_S: Final = 0.3


def broken(
    recording: Recording, limit_ms: float, held: Iterable[tuple[float, float]]
) -> Iterator[tuple[float, str, str]]:
    """Yield (steady clock, kind, sentence) of each broken promise about goals, calls and state.

    Args:
        recording: of the run.
        limit_ms: longest silence that the run's settings explain.
        held: when the driver was inhibited, steady clock.
    """
    pauses = tuple(held)
    for figures in goals(recording):
        yield from _of_goal(figures, recording, limit_ms, pauses)
    counted = calls(recording)
    if counted is not None and counted.unanswered:
        yield counted.t_s, "CallLost", f"{counted.unanswered} of {counted.asked} calls of a service had no answer."
    for taking in takings(recording):
        if taking.restored.age_s is None and _had_state(recording, taking.change):
            at_s = taking.change.t_s - recording.run.start_s
            said = (
                f"{taking.restored.node} began clean after the switch at {at_s:.3f} s: the other side's state was lost."
            )
            yield taking.change.t_s, "StateLost", said


def _had_state(recording: Recording, change: PlacementChange) -> bool:
    """Return whether a node of the other side had reported before a switch that it acted, so that it had state."""
    waits = _REASONS.get(change.reason) not in (Kind.LIMIT, Kind.NEED)
    by_s = change.t_s if waits else change.t_s - SNAPSHOT_RESEND_S  # a lost snapshot is sent again then
    return any(it.site != change.site and it.t_s < by_s for it in recording.restored)


_REASONS: Final = {reason.value: reason.kind for reason in Reason}


def _of_goal(
    figures: GoalFigures, recording: Recording, limit_ms: float, pauses: Sequence[tuple[float, float]]
) -> Iterator[tuple[float, str, str]]:
    last, name = figures.last, f"Goal {figures.goal}"
    if last.ending not in ("", SUCCEEDED) and recording.run.mode != ONE_SIDED:
        yield last.t_s, "GoalLost", f"{name} ended {last.ending}, and nobody had canceled it."
    if last.results > 1:
        yield last.t_s, "GoalTwice", f"{name} had {last.results} results."
    if last.backwards:
        said = f"{last.backwards} of {last.feedback} feedback messages of goal {figures.goal} came out of order."
        yield last.t_s, "GoalBackwards", said
    silent_s = figures.silent_s - figures.silence_ms / 1e3
    paused = any(since_s < figures.silent_s and until_s > silent_s for since_s, until_s in pauses)
    if figures.silence_ms > limit_ms and silent_s >= recording.run.start_s and not paused:
        at_s = silent_s - recording.run.start_s
        said = f"The feedback of goal {figures.goal} was silent for {figures.silence_ms:.0f} ms from {at_s:.3f} s on"
        explained = f"more than the {limit_ms:.0f} ms that detection, activation and one period explain."
        yield silent_s, "GoalGap", f"{said}, {explained}"
