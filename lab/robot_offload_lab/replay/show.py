"""Outcomes as text for a terminal."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

import numpy as np
from rich import box
from rich.table import Table

from robot_offload_core.fence.token import Site
from robot_offload_lab.replay.costs import Change
from robot_offload_lab.replay.study import Replayed, StudiedLink
from robot_offload_lab.replay.tune import TuningReport

STRIP_COLUMNS = 72
SHADES = "░▒▓█"
"""From almost never to almost always."""


def heading(subject: StudiedLink) -> str:
    """Return what was replayed, in one line."""
    settings = subject.settings
    good = float(subject.beats.good(subject.limit_us).mean())
    return (
        f"{subject.beats.name}: {subject.beats.duration_us / 1e6:.0f} s, good enough up to "
        f"{settings.allowed_loop_s * 1e3:g} ms (tolerance {settings.tolerance_s * 1e3:g} ms), {good:.1%} of the time"
    )


def table(subject: StudiedLink, outcomes: Sequence[Replayed]) -> Table:
    """Return one row per policy, then the best fixed rule and the optimum."""
    found = _table("policy", "cost J", "of optimum", "of best fixed", "exposed s", "wasted s", "switches", "cloud %")
    for each in [*outcomes, subject.best]:
        figures = each.score
        if each is subject.best:
            fixed = subject.best_fixed.cost
            found.add_row("best fixed", f"{fixed:.1f}", _times(subject.ratio(fixed)), "1.00")
        found.add_row(
            each.policy,
            f"{figures.cost:.1f}",
            _times(subject.ratio(figures.cost)),
            _times(subject.ratio_best_fixed(figures.cost)),
            f"{figures.exposed_s:.2f}",
            f"{figures.wasted_s:.2f}",
            f"{figures.switches}",
            f"{figures.cloud_pct:.1f}",
        )
    return found


def summary(done: Sequence[tuple[StudiedLink, Sequence[Replayed]]]) -> Table:
    """Return J of each policy as a multiple of the best fixed rule: mean and worst over all recordings."""
    found = _table("policy", "mean of best fixed", "worst", "on")
    for index, first in enumerate(done[0][1]):
        ratios = [(subject.ratio_best_fixed(each[index].score.cost), subject.beats.name) for subject, each in done]
        known = [(ratio, name) for ratio, name in ratios if ratio is not None]
        worst, where = max(known, default=(None, "-"))
        mean = statistics.mean(ratio for ratio, _ in known) if known else None
        found.add_row(first.policy, _times(mean), _times(worst), where)
    return found


def _table(first: str, *figures: str) -> Table:
    found = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    found.add_column(first)
    for name in figures:
        found.add_column(name, justify="right")
    return found


def _times(ratio: float | None) -> str:
    return "-" if ratio is None else f"{ratio:.2f}"


def strips(subject: StudiedLink, chosen: Replayed) -> list[str]:
    """Return link and placement over time, one character for each stretch: the fuller, the better."""
    columns = min(STRIP_COLUMNS, len(subject.beats.sent_us))
    edges_us = np.linspace(0, subject.beats.duration_us, columns + 1)
    parts = np.array_split(subject.beats.good(subject.limit_us).astype(float), columns)
    cloud = np.diff(np.interp(edges_us, *_cloud_until(chosen.changes, subject.beats.duration_us))) / np.diff(edges_us)
    return [
        f"link good  {_shaded([float(part.mean()) for part in parts])}",
        f"in cloud   {_shaded(cloud.tolist())}  {chosen.policy}",
        f"in cloud   {_optimum(subject, edges_us)}  optimum",
        f"           0 s{subject.beats.duration_us / 1e6:>{columns - 5}.0f} s",
    ]


def _optimum(subject: StudiedLink, edges_us: np.typing.NDArray[np.float64]) -> str:
    curve = _cloud_until(subject.best.changes, subject.beats.duration_us)
    return _shaded((np.diff(np.interp(edges_us, *curve)) / np.diff(edges_us)).tolist())


def _cloud_until(changes: Sequence[Change], end_us: int) -> tuple[list[int], list[int]]:
    """Return moments, and the time spent in the cloud until each."""
    times_us, spent_us, site = [0], [0], Site.ROBOT
    for at_us, following in [*((change.at_us, change.site) for change in changes), (end_us, Site.ROBOT)]:
        spent_us.append(spent_us[-1] + (at_us - times_us[-1] if site is Site.CLOUD else 0))
        times_us.append(at_us)
        site = following
    return times_us, spent_us


def _shaded(shares: Sequence[float]) -> str:
    return "".join(" " if share <= 0 else SHADES[min(len(SHADES) - 1, int(share * len(SHADES)))] for share in shares)


def tuning(reports: Sequence[TuningReport]) -> Table:
    """Return one row for each recording that was left out, with the figures that were best on the others."""
    found = _table(
        "left out", "hold-down s", "handicap", "margin", "half-life s", "J with these", "J at present",
        "best other rule", "best fixed", "optimum",
    )  # fmt: skip
    for report in reports:
        figures = report.figures
        found.add_row(
            report.trace,
            f"{figures.hold_down_initial_s:g}",
            f"{figures.handicap:g}",
            f"{figures.margin:g}",
            f"{figures.half_life_s:g}",
            f"{report.tuned:.1f}",
            f"{report.present:.1f}",
            f"{report.rival_cost:.1f} ({report.rival})",
            f"{report.best_fixed:.1f}",
            f"{report.optimum:.1f}",
        )
    return found
