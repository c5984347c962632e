"""The pictures of the page, drawn with matplotlib without any global state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from robot_offload.bench.analysis import commanded, cuts, latency
from robot_offload.bench.results import Figure, Outcome, Priority, Sample, at_or_none
from robot_offload.bench.table import PRIORITY_WORDS
from robot_offload.local.report_figures import png

SIZE_IN: Final = (9.0, 3.4)
COLOURS: Final[dict[Priority, str]] = {"realtime": "#0072B2", "normal": "#D55E00"}
PIECES: Final = {
    "detection_ms": ("detection", "#0072B2"),
    "activation_ms": ("activation", "#E69F00"),
    "phase_ms": ("timer phase", "#999999"),
    "rest_ms": ("activation and phase, not told apart", "#DDDDDD"),
}
CUTS_CAPTION: Final = (
    "Sudden cuts of both directions: the gap of each and what it is made of. A gap is shorter than its parts where the "
    "cloud's last command came after its last good beat"
)
WAYS: Final = {
    "link": ("the link itself", "#BBBBBB"),
    "input": ("robot to cloud", "#E69F00"),
    "command": ("cloud to robot", "#0072B2"),
    "direct": ("direct DDS", "#009E73"),
}


@dataclass(frozen=True)
class Picture:
    """A PNG file and what it shows."""

    png: bytes
    caption: str


def draw(outcomes: Sequence[Outcome]) -> dict[str, Picture]:
    """Every picture for which there are samples, by name."""
    drawings: dict[str, tuple[str, Callable[[Sequence[Outcome]], Canvas]]] = {
        commanded.GROUP: ("Command gaps at commanded switches", commanded_gaps),
        cuts.GROUP: (CUTS_CAPTION, cut_gaps),
        latency.GROUP: ("One-way latency by payload, median and 99th percentile", latencies),
    }
    found = {}
    for group, (caption, drawing) in drawings.items():
        there = [outcome for outcome in outcomes if outcome.group == group and outcome.samples]
        if there:
            found[f"bench-{group}"] = Picture(png(drawing(there)), caption)
    return found


def commanded_gaps(outcomes: Sequence[Outcome]) -> Canvas:
    """The share of switches with at most a gap, for each priority."""
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


def cut_gaps(outcomes: Sequence[Outcome]) -> Canvas:
    """Each cut of both directions as a stack of its parts, the shortest gap first."""
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
    """What is left of a gap whose activation was not seen in time; the last command may come after the last beat."""
    rest_ms = 0.0
    if not _is_number(fall["activation_ms"]):
        rest_ms = max(0.0, fall["gap_ms"] - (fall["before_ms"] or 0.0) - (fall["detection_ms"] or 0.0))
    return {**fall, "rest_ms": rest_ms}


def latencies(outcomes: Sequence[Outcome]) -> Canvas:
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
    """One for all axes, below them."""
    handles, words = canvas.axes[0].get_legend_handles_labels()
    canvas.legend(handles, words, fontsize=8, loc="outside lower center", ncols=3)


def _limits(line: Callable[..., Any], figure: Figure | None) -> None:
    """Dashed lines for what is demanded."""
    if figure is not None:
        for value, words, style in ((figure.must, "must", "--"), (figure.aim, "aim", ":")):
            if value is not None:
                line(value, color="#333333", linewidth=0.9, linestyle=style, label=f"{words} (p99) {value:g} ms")


def _named(outcomes: Iterable[Outcome], name: str) -> Figure | None:
    return next((figure for outcome in outcomes for figure in outcome.figures if figure.name == name), None)


def _is(sample: Sample, way: str, size: int) -> bool:
    return bool(sample["way"] == way and int(sample["payload_bytes"]) == size)


def _numbers(samples: Iterable[Sample], name: str) -> list[float]:
    return [sample[name] for sample in samples if _is_number(sample[name])]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)
