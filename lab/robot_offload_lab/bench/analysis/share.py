"""How much of the good time the cloud was in charge: a detector that never trusts the cloud raises no false alarm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import PlacementChange

MUST_SHARE: Final = 0.8


def stays(placements: Sequence[PlacementChange], site: str) -> tuple[Interval, ...]:
    """Return when a side was in charge; the last stay is open."""
    found: list[Interval] = []
    since_s: float | None = None
    for change in placements:
        if change.site == site and since_s is None:
            since_s = change.decided_s
        elif change.site != site and since_s is not None:
            found.append(Interval(since_s, change.decided_s))
            since_s = None
    if since_s is not None:
        found.append(Interval(since_s, float("inf")))
    return tuple(found)


def cloud_share(placements: Sequence[PlacementChange], good: Sequence[Interval]) -> float | None:
    """Return the cloud's share of the good time, from 0 to 1; None when there was none."""
    total_s = sum(interval.length_s for interval in good)
    if total_s <= 0:
        return None
    return sum(stay.overlap_s(interval) for stay in stays(placements, "cloud") for interval in good) / total_s
