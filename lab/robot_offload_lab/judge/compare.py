"""One picture of the same drive in several modes: with both sides, the robot alone, the cloud alone.

This is the reason to want two sides: as fast as the cloud, as steady as the robot. Pure but for `write`.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from robot_offload_lab.judge import drawing
from robot_offload_lab.judge.drawing import BLUE, GREEN, INK, ORANGE, SILVER, style
from robot_offload_lab.judge.handed import SUCCEEDED
from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Recording

_COLOURS: Final = {"offload": GREEN, "robot-only": ORANGE, "cloud-only": BLUE}
_WORDS: Final = {"offload": "both sides", "robot-only": "robot alone", "cloud-only": "cloud alone"}
FIGURES: Final = (
    ("seconds", "time of the run (s)"),
    ("metres", "way driven (m)"),
    ("standing_s", "standing still (s)"),
    ("succeeded", "goals reached"),
    ("not_reached", "goals lost or on the way"),
    ("robot_percent", "processor of the robot (%)"),
)
"""The bars: key and words."""
STANDING_MPS: Final = 0.03
AGENT: Final = "robot-agent"

Mode = str


def figures(report: Mapping[str, Any], recording: Recording) -> dict[str, float]:
    """Return the figures of one run.

    `robot_percent` covers the application and its agent on the robot, including the simulator of an example.
    """
    points = recording.path
    pairs = list(itertools.pairwise(points))
    endings = [goal["ending"] for goal in report["goals"]]
    processor = report["processor"]
    return {
        "seconds": round(report["duration_s"], 1),
        "metres": round(sum(math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) for a, b in pairs), 1),
        "standing_s": round(sum(b.t_s - a.t_s for a, b in pairs if b.speed_mps < STANDING_MPS), 1),
        "succeeded": endings.count(SUCCEEDED),
        "not_reached": len(endings) - endings.count(SUCCEEDED),
        "robot_percent": round(sum(share for name, share in processor.items() if name.startswith("robot-")), 1),
    }


def write(runs: Mapping[Mode, tuple[Mapping[str, Any], Recording]], out: Path) -> Mapping[Mode, Mapping[str, float]]:
    """Write `compare.json` and `compare.png` into `out`; return the figures by mode.

    Args:
        runs: report and recording of each mode.
        out: a folder, made if needed.

    Raises:
        OSError: the files cannot be written.
    """
    found = {mode: figures(report, recording) for mode, (report, recording) in runs.items()}
    out.mkdir(parents=True, exist_ok=True)
    (out / "compare.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    recordings = {mode: recording for mode, (_, recording) in runs.items()}
    (out / "compare.png").write_bytes(drawing.png(picture(recordings, found)))
    return found


def lines(found: Mapping[Mode, Mapping[str, float]]) -> Sequence[str]:
    """Return a table for a terminal."""
    head = f"{'':28}" + "".join(f"{mode:>12}" for mode in found)
    rows = [f"{words:28}" + "".join(f"{of[key]:12g}" for of in found.values()) for key, words in FIGURES]
    return [head, *rows]


def picture(recordings: Mapping[Mode, Recording], found: Mapping[Mode, Mapping[str, float]]) -> Figure:
    """Draw how far each drive got, and a small picture for each figure."""
    with style():
        figure = Figure(figsize=(10.0, 6.2), layout="constrained")
        grid = figure.add_gridspec(2, len(FIGURES), height_ratios=(3, 2))
        draw_progress(figure.add_subplot(grid[0, :]), recordings)
        modes = list(found)
        for column, (key, words) in enumerate(FIGURES):
            axes = figure.add_subplot(grid[1, column])
            bars = axes.bar(range(len(modes)), [found[mode][key] for mode in modes], 0.7, color=_colours(modes))
            axes.bar_label(bars, fmt="%g", fontsize=8)
            axes.set_title(words, fontsize=8)
            axes.set_xticks([])
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
    return figure


def draw_progress(axes: Axes, recordings: Mapping[Mode, Recording]) -> None:
    """Draw the way driven over time, a line for each mode; outages of the link are hatched."""
    for mode, recording in recordings.items():
        times, ways, way_m = [0.0], [0.0], 0.0
        for before, after in itertools.pairwise(recording.path):
            way_m += math.dist((before.x_m, before.y_m), (after.x_m, after.y_m))
            times.append(after.t_s - recording.run.start_s)
            ways.append(way_m)
        axes.plot(times, ways, color=_COLOURS.get(mode, INK), linewidth=2, label=_WORDS.get(mode, mode))
        if recording.outcome is not None and recording.outcome.goal_reached:
            axes.plot(times[-1], ways[-1], marker="o", color=_COLOURS.get(mode, INK))
    linked = max(
        recordings.values(), key=lambda recording: recording.end_s - recording.run.start_s if recording.link else 0
    )
    for outage in measure(linked).outages:
        since_s = outage.start_s - linked.run.start_s
        axes.axvspan(since_s, since_s + outage.length_s, facecolor=SILVER, alpha=0.35, hatch="///", edgecolor=INK, lw=0)
    axes.set_xlabel("time (s); hatched: the link is cut; a dot: all goals reached")
    axes.set_ylabel("way driven (m)")
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.legend(loc="upper left", fontsize=9)
    axes.set_title("The same patrol in three ways", loc="left", fontsize=10, fontweight="bold")


def _colours(modes: Sequence[Mode]) -> list[str]:
    return [_COLOURS.get(mode, INK) for mode in modes]
