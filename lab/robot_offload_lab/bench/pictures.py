"""The pictures of the page, drawn with matplotlib without any global state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from robot_offload_lab.bench.analysis import latency
from robot_offload_lab.bench.results import Figure, GroupResult, Priority, Sample, at_or_none
from robot_offload_lab.bench.table import PRIORITY_WORDS
from robot_offload_lab.judge.drawing import BLUE, GREEN, GREY, INK, ORANGE, PALE, SILVER, VERMILION, png

SIZE_IN: Final = (9.0, 3.4)
COLOUR_MAP: Final = colormaps["tab20"]
COLOURS: Final[dict[Priority, str]] = {"realtime": BLUE, "normal": VERMILION}
PIECES: Final = {
    "detection_ms": ("detection", BLUE),
    "activation_ms": ("activation", ORANGE),
    "phase_ms": ("timer phase", GREY),
    "rest_ms": ("activation and phase together", PALE),
}
CUTS_CAPTION: Final = (
    "Sudden cuts of both directions: the gap of each and what it is made of. A gap is shorter than its parts where the "
    "cloud's last command came after its last good beat"
)
WAYS: Final = {
    "link": ("the link itself", SILVER),
    "input": ("robot to cloud", ORANGE),
    "command": ("cloud to robot", BLUE),
    "direct": ("direct DDS", GREEN),
}


@dataclass(frozen=True)
class Picture:
    """A PNG file and what it shows."""

    png: bytes
    caption: str


def draw(outcomes: Sequence[GroupResult], notes: Mapping[str, str] = MappingProxyType({})) -> dict[str, Picture]:
    """Returns every picture for which there are samples, by name.

    Args:
        outcomes: with their samples.
        notes: group -> what is written on its pictures, such as the machine.
    """
    found = {}
    for name, drawing in _drawings().items():
        group = name.removeprefix("bench-").removesuffix(SPREAD)
        there = [outcome for outcome in outcomes if outcome.group == group and outcome.samples]
        if there:
            canvas = drawing(there)
            canvas.suptitle(notes.get(group, ""), fontsize=6, color="#666666")
            found[name] = Picture(png(canvas), CAPTIONS[name])
    return found


def _drawings() -> dict[str, Callable[[Sequence[GroupResult]], Canvas]]:
    own: dict[str, Callable[[Sequence[GroupResult]], Canvas]] = {
        "bench-commanded": commanded_gaps,
        "bench-cuts": cut_gaps,
        "bench-latency": latencies,
    }
    for group in SPREADS:
        own[f"bench-{group}{SPREAD}"] = partial(spread, group)
    return {name: own[name] for name in CAPTIONS}


@dataclass(frozen=True)
class Spread:
    """What is shown as distributions.

    Attributes:
        caption: of the picture; the axis is in milliseconds.
        value: name of the values in the samples.
        series: names of the fields that distinguish the curves.
    """

    caption: str
    value: str
    series: tuple[str, ...]


SPREAD: Final = "-spread"
SPREADS: Final = {
    "experiment": Spread("Latency of ten topics at 10 Hz", "ms", ("series",)),
    "lifecycle": Spread("Activation and deactivation as the manager sees it", "ms", ("series",)),
    "commanded": Spread("Command gaps at commanded switches, by the new side", "gap_ms", ("to",)),
    "cuts": Spread("Command gaps at sudden cuts, by direction", "gap_ms", ("direction",)),
    "latency": Spread("One-way latency by way and payload", "latency_ms", ("way", "payload_bytes")),
    "detect": Spread("From the cut until it is noticed", "noticed_ms", ("series",)),
    "collector": Spread("Through the collector, and direct", "ms", ("series",)),
}
CAPTIONS: Final = {
    "bench-experiment-spread": SPREADS["experiment"].caption,
    "bench-lifecycle-spread": SPREADS["lifecycle"].caption,
    "bench-commanded": "Command gaps at commanded switches",
    "bench-commanded-spread": SPREADS["commanded"].caption,
    "bench-cuts": CUTS_CAPTION,
    "bench-cuts-spread": SPREADS["cuts"].caption,
    "bench-latency": "One-way latency by payload, median and 99th percentile",
    "bench-latency-spread": SPREADS["latency"].caption,
    "bench-detect-spread": SPREADS["detect"].caption,
    "bench-collector-spread": SPREADS["collector"].caption,
}
"""By name of the picture."""
LINE_IN: Final = 0.24
LEAST_IN: Final = 3.0
WIDE_FACTOR: Final = 30.0
"""Values that differ by more are drawn on a logarithmic axis."""


def spread(group: str, outcomes: Sequence[GroupResult]) -> Canvas:
    """Draws the share of samples with at most a value on the left, boxes from quartile to quartile on the right."""
    of = SPREADS[group]
    found: dict[str, list[float]] = {}
    for outcome in outcomes:
        words = f" ({PRIORITY_WORDS[outcome.priority]})" if len(outcomes) > 1 else ""
        for sample in outcome.samples:
            if _is_number(sample[of.value]):
                name = ", ".join(_word(sample[field]) for field in of.series)
                found.setdefault(name + words, []).append(float(sample[of.value]))
    height = max(LEAST_IN, LINE_IN * len(found) + 1.0)
    canvas = Canvas(figsize=(SIZE_IN[0] * 1.3, height), layout="constrained")
    if not found:
        return canvas
    curves, boxes = canvas.subplots(1, 2, width_ratios=(1.3, 1))
    colours = [COLOUR_MAP(number % COLOUR_MAP.N) for number in range(len(found))]
    for (name, values), colour in zip(found.items(), colours, strict=True):
        values.sort()
        shares = [index / len(values) * 100 for index in range(len(values) + 1)]
        curves.step([values[0], *values], shares, where="post", color=colour, label=name, linewidth=1.1)
    drawn = boxes.boxplot(list(found.values()), orientation="horizontal", patch_artist=True, sym=".", widths=0.6)
    for patch, colour in zip(drawn["boxes"], colours, strict=True):
        patch.set_facecolor(colour)
    for line in drawn["medians"]:
        line.set_color("black")
    boxes.set_yticks(range(1, len(found) + 1), [f"{name}, n={len(values)}" for name, values in found.items()], size=7)
    boxes.invert_yaxis()
    everything = [value for values in found.values() for value in values]
    for axes in (curves, boxes):
        axes.set_xlabel("ms")
        if min(everything) > 0 and max(everything) > WIDE_FACTOR * min(everything):
            axes.set_xscale("log")
    curves.set_ylabel("samples (%)")
    curves.set_ylim(0, 102)
    return canvas


def _word(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def commanded_gaps(outcomes: Sequence[GroupResult]) -> Canvas:
    """Draws the share of switches with at most a gap, for each priority."""
    canvas = _canvas()
    axes = canvas.subplots()
    for outcome in outcomes:
        gaps = sorted(_numbers(outcome.samples, "gap_ms"))
        shares = [(index + 1) / len(gaps) * 100 for index in range(len(gaps))]
        words = f"{PRIORITY_WORDS[outcome.priority]}, {len(gaps)} switches"
        axes.step(gaps, shares, where="post", color=COLOURS[outcome.priority], label=words)
    _limits(axes.axvline, _named(outcomes, "gap_p99"))
    axes.set_xlabel("command gap (ms)")
    axes.set_ylabel("switches (%)")
    axes.set_xlim(left=0)
    _legend(canvas)
    return canvas


def cut_gaps(outcomes: Sequence[GroupResult]) -> Canvas:
    """Draws each cut of both directions as a stack of its parts, the shortest gap first."""
    canvas = _canvas(len(outcomes))
    for axes, outcome in zip(_row(canvas, len(outcomes)), outcomes, strict=True):
        falls = [s for s in outcome.samples if s["direction"] == "both" and _is_number(s["gap_ms"])]
        falls = sorted((_with_rest(sample) for sample in falls), key=lambda sample: float(sample["gap_ms"]))
        base = [0.0] * len(falls)
        for name, (words, colour) in PIECES.items():
            heights = [float(sample[name] or 0.0) for sample in falls]
            axes.bar(range(1, len(falls) + 1), heights, 0.9, base, color=colour, label=words)
            base = [low + height for low, height in zip(base, heights, strict=True)]
        numbers = range(1, len(falls) + 1)
        axes.scatter(numbers, [s["gap_ms"] for s in falls], 8, "black", zorder=3, label="gap felt by the consumer")
        _limits(axes.axhline, _named([outcome], "gap_both_p99"))
        axes.set_title(PRIORITY_WORDS[outcome.priority], fontsize=10)
        axes.set_xlabel("cut")
        axes.set_ylabel("ms")
    _legend(canvas)
    return canvas


def _with_rest(fall: Sample) -> Sample:
    """Returns the rest of a gap whose activation was not seen in time; the last command may follow the last beat."""
    rest_ms = 0.0
    if not _is_number(fall["activation_ms"]):
        rest_ms = max(0.0, fall["gap_ms"] - (fall["before_ms"] or 0.0) - (fall["detection_ms"] or 0.0))
    return {**fall, "rest_ms": rest_ms}


def latencies(outcomes: Sequence[GroupResult]) -> Canvas:
    """Bars of medians with a line up to the 99th percentile, by way and payload."""
    canvas = _canvas(len(outcomes))
    for axes, outcome in zip(_row(canvas, len(outcomes)), outcomes, strict=True):
        sizes = sorted({int(sample["payload_bytes"]) for sample in outcome.samples})
        width = 0.8 / len(WAYS)
        for offset, (way, (words, colour)) in enumerate(WAYS.items()):
            found = [_numbers((s for s in outcome.samples if _is(s, way, size)), "latency_ms") for size in sizes]
            middles = [at_or_none(values, 0.5) or 0.0 for values in found]
            highs = [at_or_none(values, 0.99) or 0.0 for values in found]
            places = [index + (offset - (len(WAYS) - 1) / 2) * width for index in range(len(sizes))]
            whiskers = [[0.0] * len(sizes), [max(0.0, h - m) for h, m in zip(highs, middles, strict=True)]]
            axes.bar(places, middles, width, color=colour, label=words, yerr=whiskers, capsize=2)
        axes.set_xticks(range(len(sizes)), [latency.text(size) for size in sizes])
        axes.set_title(PRIORITY_WORDS[outcome.priority], fontsize=10)
        axes.set_ylabel("one way (ms)")
    _legend(canvas)
    return canvas


def _canvas(columns: int = 1) -> Canvas:
    width, height = SIZE_IN
    return Canvas(figsize=(width * (1.15 if columns > 1 else 1), height), layout="constrained")


def _row(canvas: Canvas, columns: int) -> list[Axes]:
    """Axes beside each other that share their scale."""
    first = canvas.add_subplot(1, columns, 1)
    return [first, *(canvas.add_subplot(1, columns, number, sharey=first) for number in range(2, columns + 1))]


def _legend(canvas: Canvas) -> None:
    """Draws one legend for all axes, below them."""
    handles, words = canvas.axes[0].get_legend_handles_labels()
    canvas.legend(handles, words, fontsize=8, loc="outside lower center", ncols=3)


def _limits(line: Callable[..., Any], figure: Figure | None) -> None:
    """Dashed lines for what is demanded."""
    if figure is not None:
        for value, words, style in ((figure.must, "must", "--"), (figure.aim, "aim", ":")):
            if value is not None:
                line(value, color=INK, linewidth=0.9, linestyle=style, label=f"{words} (p99) {value:g} ms")


def _named(outcomes: Iterable[GroupResult], name: str) -> Figure | None:
    return next((figure for outcome in outcomes for figure in outcome.figures if figure.name == name), None)


def _is(sample: Sample, way: str, size: int) -> bool:
    return bool(sample["way"] == way and int(sample["payload_bytes"]) == size)


def _numbers(samples: Iterable[Sample], name: str) -> list[float]:
    return [sample[name] for sample in samples if _is_number(sample[name])]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)
