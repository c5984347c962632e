"""A picture of cuts: robot on the left, cloud on the right, and what crosses between them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from robot_offload.survey.crossing import size_text
from robot_offload_lab.advise.model import Problem

ROBOT, CLOUD, LINE = "#0072B2", "#D55E00", "#888888"
"""From the palette of Okabe and Ito, which colour-blind people can tell apart."""
ARROW = {"arrowstyle": "->", "color": LINE, "shrinkA": 28, "shrinkB": 28}
MOST_LABELS = 12


def draw(problem: Problem, cuts: Sequence[frozenset[str]], file: Path) -> None:
    """Writes the picture; the kind of file follows from its name."""
    rows = max(len(problem.parts), 4)
    figure, axes = plt.subplots(1, len(cuts), figsize=(5.5 * len(cuts), min(30.0, 1.0 + 0.45 * rows)), squeeze=False)
    try:
        for number, (cut, panel) in enumerate(zip(cuts, axes[0], strict=True), 1):
            _panel(problem, cut, panel, number)
        figure.tight_layout()
        figure.savefig(file)
    finally:
        plt.close(figure)


def _panel(problem: Problem, cut: frozenset[str], axes: Axes, number: int) -> None:
    places: dict[str, tuple[float, float]] = {}
    for side, names, colour in ((0.0, [it for it in problem.parts if it not in cut], ROBOT), (1.0, sorted(cut), CLOUD)):
        for at, name in enumerate(names):
            places[name] = (side, (at + 0.5) / len(names))
            box = {"boxstyle": "round", "facecolor": "white", "edgecolor": colour}
            cpu = problem.parts[name].cpu
            axes.text(*places[name], f"{name}\n{cpu:.1%}", ha="center", va="center", fontsize=7, bbox=box, zorder=3)
    crossing = sorted(problem.crossing(cut), key=lambda flow: -flow.bytes_per_s)
    for at, flow in enumerate(crossing):
        start = places[flow.publisher]
        for hearer in flow.hearers:
            if (hearer in cut) != (flow.publisher in cut):
                axes.annotate("", places[hearer], start, arrowprops=ARROW, zorder=1)
        if at < MOST_LABELS:
            height = (at + 0.5) / min(len(crossing), MOST_LABELS)
            axes.text(0.5, height, f"{flow.topic} {size_text(flow.bytes_per_s)}/s", ha="center", fontsize=6, zorder=4)
    axes.set_title(
        f"Cut {number}: {problem.saved(cut):.1%} of a core, {size_text(problem.bytes_per_s(cut))}/s", fontsize=9
    )
    axes.set_xlim(-0.4, 1.4)
    axes.set_ylim(0, 1)
    axes.set_xticks([0, 1], ["robot", "cloud"])
    axes.set_yticks([])
