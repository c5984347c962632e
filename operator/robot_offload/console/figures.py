"""The strips of one robot as options of ECharts: latency with its bound, loss, placement, changeovers. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from robot_offload.console.live import CLOUD, ROBOT, Changeover, Point
from robot_offload.console.model import Track

COLOURS: Final = {ROBOT: "#d55e00", CLOUD: "#0072b2", "bound": "#555555", "loss": "#999999"}
"""Of the palette of Okabe and Ito, whose colours differ for every kind of colour vision."""
WINDOW_S: Final = 120.0
LABELLED_S: Final = 10.0
"""A shorter stay has no room for its name; its colour and its edges say it."""
SIGNS: Final = {ROBOT: "▲", CLOUD: "☁"}
NAMES: Final = {ROBOT: "robot acts", CLOUD: "cloud acts"}


def strips(track: Track, end_s: float, *, run: bool, window_s: float = WINDOW_S) -> dict[str, Any]:
    """Returns the chart of the stretch that ends at a moment.

    Args:
        track: of the robot.
        end_s: the right edge, on the source's clock.
        run: times count from the start of a run; otherwise they are those of the system's clock.
        window_s: how much is seen.
    """
    points = track.window(end_s - window_s, end_s)
    scale = 1.0 if run else 1e3
    axis: dict[str, Any] = {"min": (end_s - window_s) * scale, "max": end_s * scale, "type": "value" if run else "time"}
    return {
        "animation": False,
        "aria": {"enabled": True},
        "grid": [
            {"left": 55, "right": 15, "top": 30, "height": 150},
            {"left": 55, "right": 15, "top": 205, "height": 45},
        ],
        "tooltip": {"trigger": "axis"},
        "legend": {"top": 0, "data": ["loop latency", "99th percentile", "loss"]},
        "xAxis": [
            {**axis, "gridIndex": 0, "axisLabel": {"show": False}},
            {**axis, "gridIndex": 1, "axisLabel": {"formatter": "{value} s"} if run else {}},
        ],
        "yAxis": [
            {"gridIndex": 0, "name": "ms", "min": 0},
            {"gridIndex": 1, "name": "loss %", "min": 0, "max": 100, "splitNumber": 1},
        ],
        "series": list(_series(track, points, scale, end_s, window_s)),
    }


def _series(
    track: Track, points: Sequence[Point], scale: float, end_s: float, window_s: float
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
                *(_mark(change, scale) for change in track.changeovers if end_s - window_s <= change.t_s <= end_s),
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
        label = {"formatter": "{b}", "position": "insideEndTop"}
        yield {"yAxis": allowed_ms, "name": f"bound {allowed_ms:g} ms", "label": label}


def _loss_percent(point: Point) -> float | None:
    if point.cut:
        return 100.0
    return None if point.loss_share is None else round(point.loss_share * 100, 1)


def _mark(change: Changeover, scale: float) -> dict[str, Any]:
    gap = "" if change.gap_ms is None else f" {change.gap_ms:.0f} ms"
    return {
        "xAxis": _rounded(change.t_s * scale),
        "name": f"{SIGNS.get(change.to, '?')}{gap}",
        "lineStyle": {"color": COLOURS.get(change.to, "#555555"), "type": "solid"},
        "label": {"formatter": "{b}", "fontSize": 10},
    }


def _bands(points: Sequence[Point], scale: float) -> Iterator[list[dict[str, Any]]]:
    """Yields a pair of edges for each stay on a side."""
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
