"""The fleet's table as plain values, one row a robot: shown values and sort keys. Pure."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from typing import Any, Final

from robot_offload.console.live import CLOUD, ROBOT, Point
from robot_offload.console.model import SILENT_S, Track
from robot_offload.insight.observed import ago

SPARK_S: Final = 120.0
SPARK_WIDTH: Final = 120
SPARK_HEIGHT: Final = 24
SPARK_POINTS: Final = 60
"""One for each two seconds: more would not be visible on so little room."""
PLACES: Final = {ROBOT: "▲ Robot", CLOUD: "☁ Cloud"}
"""A sign beside the word, readable without seeing colours."""
SORTED_LAST: Final = 1e12


def row(track: Track, now_s: float, now: datetime.datetime) -> dict[str, Any]:
    """Return one robot's line; `now_s` is the source's clock, `now` the system's."""
    observed, live = track.observed, track.live
    heard = track.heard_s is not None
    old = not heard or now_s - (track.heard_s or 0.0) > SILENT_S or bool(track.problem)
    last = track.changeovers[-1] if track.changeovers else None
    reason, message = (live.reason, live.message) if heard and not track.problem else _declared(track)
    return {
        "id": str(track.key),
        "link": f"robot/{track.key.namespace or '-'}/{track.key.name}",
        "name": track.key.name,
        "namespace": track.key.namespace,
        "placement": PLACES.get(track.site, "? Unknown"),
        "reason": ": ".join(part for part in (reason, message) if part),
        "quality": _quality(track, old),
        "trouble": track.problem,
        "latency": SORTED_LAST if old or live.latency_ms is None else live.latency_ms,
        **spark(track.window(now_s - SPARK_S, now_s), now_s, track.bounds.allowed_ms),
        "gap": "" if last is None or last.gap_ms is None else f"{last.gap_ms:.0f} ms",
        "silence": -1.0 if last is None or last.gap_ms is None else last.gap_ms,
        "ready": _ready(track),
        "generation": observed.generation if observed else 0,
        "since": _since(track, now_s, now),
        "sinceSeconds": _since_s(track, now_s, now),
    }


def spark(points: Sequence[Point], now_s: float, allowed_ms: float | None) -> Mapping[str, Any]:
    """Return the last two minutes of a link as coordinates of a small picture: a line, the cuts, the bound."""
    worst_ms = max((point.latency_ms for point in points if point.latency_ms is not None), default=0.0)
    top_ms = max(worst_ms, (allowed_ms or 0.0) * 1.5, 1.0)
    slots: dict[int, Point] = {}
    for point in points:
        slot = int((point.t_s - now_s + SPARK_S) / SPARK_S * SPARK_POINTS)
        before = slots.get(slot)
        if before is None or point.cut or (point.latency_ms or 0.0) > (before.latency_ms or 0.0):
            slots[slot] = point
    step = SPARK_WIDTH / SPARK_POINTS
    line = [
        f"{slot * step:.0f},{SPARK_HEIGHT - point.latency_ms / top_ms * SPARK_HEIGHT:.1f}"
        for slot, point in sorted(slots.items())
        if point.latency_ms is not None and not point.cut
    ]
    cuts = [f"M{slot * step:.0f},0V{SPARK_HEIGHT}" for slot, point in sorted(slots.items()) if point.cut]
    bound = SPARK_HEIGHT - allowed_ms / top_ms * SPARK_HEIGHT if allowed_ms is not None else -1.0
    return {"sparkLine": " ".join(line), "sparkCuts": "".join(cuts), "sparkBound": round(bound, 1)}


def _quality(track: Track, old: bool) -> str:
    if track.problem:
        return "no live numbers"
    if track.heard_s is None:
        return "no live numbers yet"
    if old:
        return "silent"
    live = track.live
    if live.cut:
        return "✕ cut"
    if live.latency_ms is None:
        return "not known"
    allowed_ms = track.bounds.allowed_ms
    sign = "●" if allowed_ms is None or live.latency_ms <= allowed_ms else "◐ slow"
    loss = f", {live.loss_share:.0%} lost" if live.loss_share else ""
    return f"{sign} {live.latency_ms:.0f} ms{loss}"


def _declared(track: Track) -> tuple[str, str]:
    observed = track.observed
    return (observed.placement_reason, observed.placement_message) if observed else ("", "")


def _ready(track: Track) -> str:
    if track.observed is None or not track.observed.conditions:
        return "not known"
    condition = track.observed.condition("Ready")
    if track.observed.ready:
        return "✓ Ready"
    return f"✗ {condition.reason}" if condition and not track.observed.outdated else "… in progress"


def _since_s(track: Track, now_s: float, now: datetime.datetime) -> float:
    """Return for how long the side has acted, or else how long the robot's connection has been as it is."""
    if track.changeovers:
        return max(0.0, now_s - track.changeovers[-1].t_s)
    try:
        moment = datetime.datetime.fromisoformat(track.observed.since if track.observed else "")
        return max(0.0, (now - moment).total_seconds())
    except (ValueError, TypeError):
        return SORTED_LAST


def _since(track: Track, now_s: float, now: datetime.datetime) -> str:
    passed_s = _since_s(track, now_s, now)
    if passed_s >= SORTED_LAST:
        return ""
    return ago((now - datetime.timedelta(seconds=passed_s)).isoformat(), now)
