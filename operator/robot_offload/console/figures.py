"""The strips of one robot as options of ECharts: latency with its bound, loss, active side, changeovers. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from robot_offload.console.live import CLOUD, ROBOT, Changeover, Point
from robot_offload.console.model import Track

COLOURS: Final = {ROBOT: "#d55e00", CLOUD: "#0072b2", "bound": "#555555", "loss": "#999999"}
"""From the palette of Okabe and Ito, distinguishable with every kind of colour vision."""
MIDDLE: Final = "#808080"
"""Readable on white and on black."""
FAINT: Final = "#80808040"
LEAST_S: Final = 10.0
"""A strip is never shorter than this."""
WINDOW_S: Final = 120.0
LABELLED_S: Final = 10.0
"""A shorter stay has no room for its name; its colour and its edges identify it."""
SIGNS: Final = {ROBOT: "▲", CLOUD: "☁"}
NAMES: Final = {ROBOT: "robot acts", CLOUD: "cloud acts"}


def strips(track: Track, end_s: float, *, run: bool, window_s: float = WINDOW_S) -> dict[str, Any]:
    """Return the chart of the period that ends at a moment.

    Args:
        track: of the robot.
        end_s: the right edge, on the source's clock.
        run: times count from the start of a run; otherwise they are the system clock's.
        window_s: length of the period.
    """
    oldest_s = track.points[0].t_s if track.points else end_s
    start_s = min(max(end_s - window_s, oldest_s), end_s - LEAST_S)
    points = track.window(start_s, end_s)
    scale = 1.0 if run else 1e3
    line = {"axisLine": {"onZero": False}, "splitLine": {"lineStyle": {"color": FAINT}}}
    across = {
        **line,
        "min": _rounded(start_s * scale),
        "max": _rounded(end_s * scale),
        "type": "value" if run else "time",
    }
    seconds = {"formatter": "{value} s", "showMaxLabel": False, "showMinLabel": False} if run else {}
    return {
        "animation": False,
        "aria": {"enabled": True},
        "textStyle": {"color": MIDDLE},
        "grid": [
            {"left": 55, "right": 15, "top": 45, "height": 150},
            {"left": 55, "right": 15, "top": 225, "height": 40},
        ],
        "tooltip": {"trigger": "axis"},
        "legend": {"top": 0, "data": ["loop latency", "99th percentile", "loss"], "textStyle": {"color": MIDDLE}},
        "xAxis": [
            {**across, "gridIndex": 0, "axisLabel": {"show": False}},
            {**across, "gridIndex": 1, "axisLabel": seconds},
        ],
        "yAxis": [
            {**line, "gridIndex": 0, "name": "ms", "min": 0, "max": _top_ms(track, points)},
            {**line, "gridIndex": 1, "name": "loss %", "min": 0, "max": 100, "splitNumber": 1},
        ],
        "series": list(_series(track, points, scale, start_s, end_s)),
    }


def _top_ms(track: Track, points: Sequence[Point]) -> float:
    """Return the upper edge: round, and above both the bound and the latency."""
    seen_ms = [point.latency_ms for point in points if point.latency_ms is not None and not point.cut]
    top_ms = max([*seen_ms, (track.bounds.allowed_ms or 0.0) * 1.3, 10.0])
    return float(math.ceil(top_ms / 20.0) * 20)


def _series(
    track: Track, points: Sequence[Point], scale: float, start_s: float, end_s: float
) -> Iterator[dict[str, Any]]:
    line = {"type": "line", "showSymbol": False, "connectNulls": False, "lineStyle": {"width": 1.5}}
    yield {
        **line,
        "name": "loop latency",
        "itemStyle": {"color": "#009e73"},
        "data": [[_rounded(p.t_s * scale), None if p.cut else p.latency_ms] for p in points],
        "markLine": {
            "silent": True,
            "symbol": "none",
            "data": [
                *_bound(track.bounds.allowed_ms),
                *_marks([change for change in track.changeovers if start_s <= change.t_s <= end_s], scale),
            ],
        },
        "markArea": {"silent": True, "data": list(_bands(points, scale))},
    }  # fmt: skip
    if any(point.p99_ms is not None for point in points):
        yield {
            **line,
            "name": "99th percentile",
            "itemStyle": {"color": "#cc79a7"},
            "lineStyle": {"width": 1, "type": "dashed"},
            "data": [[_rounded(p.t_s * scale), p.p99_ms] for p in points],
        }
    yield {
        **line,
        "name": "loss",
        "xAxisIndex": 1,
        "yAxisIndex": 1,
        "step": "end",
        "areaStyle": {},
        "itemStyle": {"color": COLOURS["loss"]},
        "data": [[_rounded(p.t_s * scale), _loss_percent(p)] for p in points],
    }


def _bound(allowed_ms: float | None) -> Iterator[dict[str, Any]]:
    if allowed_ms is not None:
        label = {"formatter": "{b}", "position": "insideStartTop", "color": MIDDLE}
        yield {"yAxis": allowed_ms, "name": f"bound {allowed_ms:g} ms", "label": label}


def _loss_percent(point: Point) -> float | None:
    if point.cut:
        return 100.0
    return None if point.loss_share is None else round(point.loss_share * 100, 1)


def _marks(changes: Sequence[Changeover], scale: float) -> Iterator[dict[str, Any]]:
    """Yield a line for each change; the newest ones are named as far as there is room."""
    named_s = float("inf")
    for change in reversed(changes):
        room = named_s - change.t_s >= LABELLED_S
        named_s = change.t_s if room else named_s
        yield _mark(change, scale, room=room)


def _mark(change: Changeover, scale: float, *, room: bool) -> dict[str, Any]:
    gap = "" if change.gap_ms is None else f" {change.gap_ms:.0f} ms"
    return {
        "xAxis": _rounded(change.t_s * scale),
        "name": f"{SIGNS.get(change.to, '?')}{gap}",
        "lineStyle": {"color": COLOURS.get(change.to, "#555555"), "type": "solid"},
        "label": {"show": room, "formatter": "{b}", "fontSize": 10, "color": MIDDLE},
    }


def _bands(points: Sequence[Point], scale: float) -> Iterator[list[dict[str, Any]]]:
    """Yield a pair of edges for each stay on a side."""
    start: Point | None = None
    last: Point | None = None
    for point in points:
        if start is None or last is None:
            start = point
        elif point.site != start.site:
            yield _band(start, point, scale)
            start = point
        last = point
    if start is not None and last is not None and last is not start:
        yield _band(start, last, scale)


def _band(start: Point, end: Point, scale: float) -> list[dict[str, Any]]:
    colour = COLOURS.get(start.site, "#bbbbbb")
    wide = (end.t_s - start.t_s) >= LABELLED_S
    label = {"show": wide, "position": "insideBottom", "fontSize": 10, "color": colour}
    return [
        {
            "name": NAMES.get(start.site, ""),
            "xAxis": _rounded(start.t_s * scale),
            "itemStyle": {"color": colour, "opacity": 0.12},
            "label": label,
        },
        {"xAxis": _rounded(end.t_s * scale)},
    ]


def _rounded(value: float) -> float:
    return round(value, 3)
