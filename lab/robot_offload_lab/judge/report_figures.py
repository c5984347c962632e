"""The pictures of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, Literal

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from robot_offload_lab.judge import handed, reasons
from robot_offload_lab.judge.drawing import INK, SILVER, SITE_COLOURS, style
from robot_offload_lab.judge.invariants import gap_limit_ms, inhibited
from robot_offload_lab.judge.measures import Interval, Measures
from robot_offload_lab.judge.recording import SITES, Site

_LINES: Final[Mapping[Site, Literal["dashed", "solid"]]] = {"robot": "dashed", "cloud": "solid"}
_HELD: Final = "#AA3377"
_OBSTACLE: Final = "#555555"
_GOAL: Final = "#117733"
WIDTH_IN: Final = 10.0
_TITLES: Final = (
    "The link between robot and cloud",
    "Who is in charge",
    "How long consumers heard nothing, at each change",
    "The way, from above",
)
MAX_BAR: Final = 0.5
"""Widest bar, as a share of the distance of two switches."""
MAX_LABELS: Final = 20
"""More labels than this side by side cannot be read."""


def link_and_placement(measures: Measures) -> Figure:
    """Return loop latency over time with outages shaded, and below it who was in charge."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, 4.4), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        draw_latency(top, measures)
        draw_placement(bottom, measures)
    return figure


def gaps_per_switch(measures: Measures) -> Figure:
    """Return the longest silence of each output at each switch."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, 2.8), layout="constrained")
        draw_gaps(figure.subplots(), measures)
    return figure


def path(measures: Measures) -> Figure:
    """Draw the way of the robot, coloured by who steered."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, 0.8 * _path_height(measures)), layout="constrained")
        draw_path(figure.subplots(), measures)
    return figure


def run(measures: Measures) -> Figure:
    """Draw everything in one picture, for a README."""
    with_path = bool(measures.recording.path)
    heights = (3.2, 2.0, 2.8, _path_height(measures)) if with_path else (3.2, 2.0, 2.8)
    with style():
        figure = Figure(figsize=(WIDTH_IN, 0.9 * sum(heights)), layout="constrained")
        axes = figure.subplots(len(heights), 1, height_ratios=heights)
        axes[1].sharex(axes[0])
        axes[0].tick_params(labelbottom=False)
        draw_latency(axes[0], measures)
        draw_placement(axes[1], measures)
        draw_gaps(axes[2], measures)
        if with_path:
            draw_path(axes[3], measures)
        for place, title in zip(axes, _TITLES, strict=False):
            place.set_title(title, loc="left", fontsize=10, fontweight="bold")
    return figure


def draw_latency(axes: Axes, measures: Measures) -> None:
    """Draw the loop latency; outages are hatched, the threshold is a dashed line."""
    recording = measures.recording
    start_s, threshold_ms = recording.run.start_s, recording.run.threshold_ms
    if not recording.link:
        axes.text(0.5, 0.5, "no link in this run", transform=axes.transAxes, ha="center", color=INK)
    times = [sample.t_s - start_s for sample in recording.link]
    latencies = [sample.rtt_ms for sample in recording.link]
    axes.step(times, [math.nan if value is None else value for value in latencies], where="post", color=INK)
    if threshold_ms > 0 and recording.link:
        axes.axhline(threshold_ms, color=INK, linewidth=0.8, linestyle="--")
        _note(axes, threshold_ms, f"above {threshold_ms:g} ms the robot is better off alone")
    for outage in measures.outages:
        _shade(axes, outage, start_s)
    handles: list[Artist] = [Line2D([], [], color=INK, label="there and back")] if recording.link else []
    if measures.outages:
        handles.append(Patch(facecolor=SILVER, alpha=0.5, hatch="///", edgecolor=INK, label="link cut"))
    if handles:
        _legend(axes, handles)
    axes.set_ylabel("loop latency\n(ms)")
    highest = max([value for value in latencies if value is not None] + [threshold_ms, 1.0])
    axes.set_ylim(0, highest * 1.25)
    axes.set_xlim(0, max(measures.duration_s, 1e-3))


def _note(axes: Axes, height: float, text: str) -> None:
    """Write a small word at the right end of a horizontal line."""
    axes.annotate(
        text,
        (1.0, height),
        (-4, 3),
        xycoords=axes.get_yaxis_transform(),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
    )


def draw_placement(axes: Axes, measures: Measures) -> None:
    """Draw who was in charge when as a band; outages are hatched, crosses mark where the driver held the wheels."""
    start_s = measures.recording.run.start_s
    for site, stay in measures.stays:
        axes.broken_barh(
            [(stay.start_s - start_s, stay.length_s)], _band(site), facecolor=SITE_COLOURS[site], edgecolor="none"
        )
    for outage in measures.outages:
        _shade(axes, outage, start_s)
    lanes = _draw_goals(axes, measures)
    reasons.draw(axes, reasons.of_robot(measures.recording), start_s, 2 + len(lanes))
    lanes.append("why the\nrobot acts")
    held = inhibited(measures.recording)
    for interval in held:
        since_s, until_s = interval.start_s - start_s, interval.end_s - start_s
        axes.axvspan(max(0.0, since_s), until_s, facecolor=_HELD, edgecolor="white", hatch="xx", linewidth=0.0)
    if held:
        _legend(axes, [Patch(facecolor=_HELD, edgecolor="white", hatch="xx", label="nobody can steer: wheels held")])
    axes.annotate(
        "time (s)", (1.0, 0.0), (0, -18), xycoords="axes fraction", textcoords="offset points", ha="right", va="top"
    )
    axes.set_ylim(0, 2 + len(lanes))
    axes.set_yticks([row + 0.5 for row in range(2 + len(lanes))], labels=[*SITES, *lanes])
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0, max(measures.duration_s, 1e-3))


def _draw_goals(axes: Axes, measures: Measures) -> list[str]:
    """Draw a lane for the goals on their way and the age of the state at each switch; return the lane's name."""
    recording = measures.recording
    figures = handed.goals(recording)
    start_s = recording.run.start_s
    for goal in figures:
        since_s, until_s = goal.first.t_s - start_s, goal.until_s - start_s
        axes.broken_barh([(since_s, until_s - since_s)], (2.1, 0.8), facecolor=_GOAL, edgecolor="white")
        if goal.last.ending:
            mark = "\N{CHECK MARK}" if goal.last.ending == handed.SUCCEEDED else "\N{MULTIPLICATION SIGN}"
            axes.annotate(
                mark, (until_s, 2.5), (-4, 0), textcoords="offset points", ha="right", va="center", color="white"
            )
    if figures:
        for taking in handed.takings(recording):
            age_s = taking.restored.age_s
            text = "clean" if age_s is None else f"{age_s * 1e3:.0f} ms"
            place = (taking.change.t_s - start_s, 2.5)
            axes.annotate(text, place, (2, 0), textcoords="offset points", va="center", fontsize=7, color="white")
    return ["goal, age of\nthe state taken"] if figures else []


def _band(site: Site) -> tuple[float, float]:
    """Return the lower edge and height of a side's lane."""
    return (SITES.index(site) + 0.1, 0.8)


def _shade(axes: Axes, interval: Interval, start_s: float) -> None:
    axes.axvspan(
        interval.start_s - start_s,
        interval.end_s - start_s,
        facecolor=SILVER,
        alpha=0.35,
        hatch="///",
        edgecolor=INK,
        linewidth=0.0,
        zorder=0,
    )


def draw_gaps(axes: Axes, measures: Measures) -> None:
    """Draw a bar per switch and output: the longest silence, in the colour of the side that took over."""
    unrated = measures.recording.run.unrated
    switches, topics = measures.switches, [topic for topic in measures.streams if topic not in unrated]
    width = 0.8 / max(1, len(topics))
    longest = 0.0
    for row, topic in enumerate(topics):
        positions = [index + (row - (len(topics) - 1) / 2) * width for index in range(len(switches))]
        lengths = [switch.gap_ms.get(topic) or 0.0 for switch in switches]
        longest = max([longest, *lengths])
        bars = axes.bar(
            positions,
            lengths,
            min(width * 0.92, MAX_BAR),
            color=[SITE_COLOURS[switch.after] for switch in switches],
            edgecolor="white",
            hatch=["" if switch.commanded else "//" for switch in switches],
        )
        if len(switches) * len(topics) <= MAX_LABELS:
            axes.bar_label(bars, fmt="%.0f", fontsize=8, padding=1)
    limit_ms = gap_limit_ms(measures.recording)
    axes.set_ylim(0, 1.15 * max(1.1 * longest, limit_ms))
    loss_ms = measures.recording.run.loss_timeout_ms
    for height_ms, word in (
        (limit_ms, f"limit {limit_ms:.0f} ms, where the wheels are not held"),
        (loss_ms, f"a loss is noticed after {loss_ms:.0f} ms"),
    ):
        axes.axhline(height_ms, color=INK, linewidth=0.8, linestyle="--")
        _note(axes, height_ms, word)
    every = 1 + len(switches) // MAX_LABELS
    times = [f"{switch.t_s - measures.recording.run.start_s:.1f} s" for switch in switches]
    axes.set_xticks(range(0, len(switches), every), labels=times[::every], fontsize=8)
    axes.set_xlim(-0.6, max(len(switches), 1) - 0.4)
    axes.set_ylabel("longest silence\n(ms)")
    handles = [Patch(facecolor=SITE_COLOURS[site], label=f"to the {site}") for site in SITES]
    handles.append(Patch(facecolor="white", edgecolor=INK, hatch="//", label="after a sudden loss"))
    _legend(axes, handles)
    if not switches:
        axes.text(0.5, 0.5, "no switch", transform=axes.transAxes, ha="center", color=INK)


def _legend(axes: Axes, handles: Sequence[Artist]) -> None:
    """Draw a legend in one row above the picture, where it hides nothing; the left is left for a title."""
    axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), ncols=len(handles), fontsize=8)


def draw_path(axes: Axes, measures: Measures) -> None:
    """Draw the corridor or the rooms from above: obstacles, and the way in the colour of the side that steered."""
    recording = measures.recording
    length_m, width_m = recording.run.corridor_length_m, recording.run.corridor_width_m
    for post in recording.obstacles:
        axes.add_patch(Circle((post.x_m, post.y_m), post.radius_m, color=_OBSTACLE))
    for site, stay in measures.stays:
        points = [point for point in recording.path if stay.start_s <= point.t_s <= stay.end_s]
        axes.plot(
            [point.x_m for point in points],
            [point.y_m for point in points],
            color=SITE_COLOURS[site],
            linewidth=2.4,
            linestyle=_LINES[site],
        )
    if recording.run.walls:
        for from_x, from_y, to_x, to_y in recording.run.walls:
            axes.plot([from_x, to_x], [from_y, to_y], color=INK, linewidth=2)
        axes.set_aspect("equal")
    elif length_m > 0 and width_m > 0:
        axes.hlines([-width_m / 2, width_m / 2], 0, length_m, color=INK, linewidth=2)
        axes.set_xlim(-0.3, length_m + 0.3)
        axes.set_ylim(-width_m / 2 - 0.15, width_m / 2 + 0.15)
    else:
        axes.autoscale()
    _mark_ends(axes, measures)
    handles: list[Artist] = [
        Line2D([], [], color=SITE_COLOURS[site], linewidth=2.4, linestyle=_LINES[site], label=f"the {site} steers")
        for site in SITES
    ]
    handles.append(
        Line2D([], [], color=_OBSTACLE, marker="o", linestyle="none", label="obstacle, unseen until close by")
    )
    _legend(axes, handles)
    axes.set_xlabel("along the corridor (m)")
    axes.set_ylabel("across (m)" if recording.run.walls else "across (m),\nstretched")


def _path_height(measures: Measures) -> float:
    """Return the height of the path picture, as a share: rooms are drawn to scale, a corridor is stretched."""
    return 5.4 if measures.recording.run.walls else 2.4


def _mark_ends(axes: Axes, measures: Measures) -> None:
    """Write words at the beginning and at the end of the way."""
    path_points = measures.recording.path
    if not path_points:
        return
    outcome = measures.recording.outcome
    at_end = "goal" if outcome is not None and outcome.goal_reached else "end of the run"
    # One word above and one below: a patrol ends where it began.
    for point, word, offset in ((path_points[0], "start", 7), (path_points[-1], at_end, -14)):
        axes.plot(point.x_m, point.y_m, marker="o", markersize=6, color=INK)
        axes.annotate(word, (point.x_m, point.y_m), (0, offset), textcoords="offset points", ha="center", fontsize=8)
