"""Link and placement over time as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from robot_offload_core.fence.token import Site
from robot_offload_lab.judge.drawing import INK, PALE, SITE_COLOURS, VERMILION, png
from robot_offload_lab.replay.costs import Change, stretches
from robot_offload_lab.replay.heartbeats import NEVER_US
from robot_offload_lab.replay.study import Replayed, StudiedLink

COLUMNS: Final = 1500
"""More points than this side by side cannot be distinguished."""


def draw(subjects: Sequence[tuple[StudiedLink, Sequence[Replayed]]]) -> bytes:
    """Return a PNG: for each recording its loop latency over time, and below it who acted under each policy."""
    heights: list[float] = []
    for _, outcomes in subjects:
        heights += [3.0, 0.32 * (len(outcomes) + 1) + 0.2]
    figure = Figure(figsize=(10, sum(heights) * 0.9 + 0.5), layout="constrained")
    axes = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    for index, (subject, outcomes) in enumerate(subjects):
        link, placement = axes[2 * index], axes[2 * index + 1]
        link.sharex(placement)
        _link(link, subject)
        _placement(placement, [*outcomes, subject.best], subject.beats.duration_us / 1e6)
    handles = [
        Patch(color=SITE_COLOURS[site.value], label=f"the {site.value} acts") for site in (Site.ROBOT, Site.CLOUD)
    ]
    handles.append(Patch(color=PALE, label="the link is not good enough"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return png(figure)


def _link(axes: Axes, subject: StudiedLink) -> None:
    """Draw the highest latency of each column, the limit, and shades where the link was not good enough."""
    beats, limit_us = subject.beats, subject.limit_us
    good = beats.good(limit_us)
    edges = np.linspace(0, len(good), min(COLUMNS, len(good)) + 1).astype(int)
    starts_s = beats.sent_us[edges[:-1]] / 1e6
    known = np.where(beats.latency_us == NEVER_US, 0, beats.latency_us)
    highest_ms = np.maximum.reduceat(known, edges[:-1]) / 1e3
    shown = np.where(highest_ms > 0, highest_ms, np.nan)
    bad = [(start_us / 1e6, length_s) for start_us, ok, length_s in stretches(good, beats.period_us) if not ok]
    axes.broken_barh(bad, (0, 1), facecolors=PALE, edgecolors=PALE, linewidth=0.5, transform=axes.get_xaxis_transform())
    axes.step(starts_s, shown, where="post", color=INK, linewidth=0.7)
    axes.axhline(limit_us / 1e3, color=VERMILION, linewidth=1, linestyle="--")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylabel("loop latency (ms)")
    words = f"{beats.name}, good enough up to {limit_us / 1e3:g} ms (dashed)"
    axes.set_title(words, fontsize=10, loc="left")
    axes.tick_params(labelbottom=False)


def _placement(axes: Axes, outcomes: Sequence[Replayed], end_s: float) -> None:
    for row, each in enumerate(outcomes):
        for site in Site:
            mine = [stay for stay in _stays(each.changes, end_s) if stay[2] is site]
            stays = [(start_s, stop_s - start_s) for start_s, stop_s, _ in mine]
            axes.broken_barh(stays, (row - 0.4, 0.8), facecolors=SITE_COLOURS[site.value], linewidth=0)
        axes.annotate(f"J {each.score.cost:.1f}", (1.005, row), xycoords=("axes fraction", "data"), fontsize=8,
                      va="center")  # fmt: skip
    axes.set_yticks(range(len(outcomes)), [each.policy for each in outcomes], fontsize=8)
    axes.set_ylim(len(outcomes) - 0.5, -0.5)
    axes.set_xlim(0, end_s)
    axes.set_xlabel("time (s)")


def _stays(changes: Sequence[Change], end_s: float) -> list[tuple[float, float, Site]]:
    """Return (from, until, side) of every stay, including the robot's first one."""
    found, start_s, site = [], 0.0, Site.ROBOT
    for change in changes:
        found.append((start_s, change.at_us / 1e6, site))
        start_s, site = change.at_us / 1e6, change.site
    return [*found, (start_s, end_s, site)]
