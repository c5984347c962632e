"""Why the robot acted, moment by moment, as words on a time line. Pure except for the drawing."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from robot_offload_lab.judge.drawing import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from robot_offload_lab.judge.recording import Recording

SHORTEST_S: Final = 0.05
"""A shorter reason would be a line without a colour."""
_COLOURS: Final = ("#CC6677", "#DDCC77", "#88CCEE", "#44AA99", "#AA4499", "#999933", "#882255", "#332288")
"""Tol's muted palette: distinct with every kind of colour vision."""

Stretch = tuple[float, float, str]


def of_robot(recording: Recording) -> tuple[Stretch, ...]:
    """Return when (steady clock) and why (in words) the robot acted; adjacent stretches of one reason are joined."""
    changes = [change for change in recording.placements if change.t_s <= recording.end_s]
    found: list[Stretch] = []
    for index, change in enumerate(changes):
        end_s = changes[index + 1].t_s if index + 1 < len(changes) else recording.end_s
        since_s = max(change.t_s, recording.run.start_s)
        if change.site != "robot" or end_s - since_s < SHORTEST_S:
            continue
        word = in_words(change.reason)
        if found and found[-1][2] == word and since_s - found[-1][1] < SHORTEST_S:
            since_s = found.pop()[0]
        found.append((since_s, end_s, word))
    return tuple(found)


def in_words(reason: str) -> str:
    """Return a reason such as `HeartbeatLost` in words: heartbeat lost."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", reason).lower()


def draw(axes: Axes, stretches: tuple[Stretch, ...], start_s: float, lane: int) -> None:
    """Draw them as a lane of the time line, with their words below the axis."""
    words = list(dict.fromkeys(word for _, _, word in stretches))
    for number, word in enumerate(words):
        spans = [(since_s - start_s, until_s - since_s) for since_s, until_s, its in stretches if its == word]
        colour = _COLOURS[number % len(_COLOURS)]
        axes.broken_barh(spans, (lane + 0.1, 0.8), facecolor=colour, edgecolor="white", linewidth=0.3)
        for since_s, length_s in spans:
            place = (since_s + length_s / 2, lane + 0.5)
            axes.annotate(str(number + 1), place, ha="center", va="center", fontsize=7, color=INK, annotation_clip=True)
    if words:
        text = "   ".join(f"{number + 1} {word}" for number, word in enumerate(words))
        axes.set_xlabel(f"why the robot acts: {text}", fontsize=8, loc="left")
