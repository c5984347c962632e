"""Figures as text: for the terminal and for the page. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from rich.table import Table

from robot_offload_lab.bench.results import Figure, GroupResult, Priority

PRIORITY_WORDS: Final[dict[Priority, str]] = {"realtime": "real-time priority", "normal": "normal priority"}
TITLES: Final = {
    "experiment": "Ten topics at 10 Hz",
    "lifecycle": "Activation and deactivation",
    "commanded": "Commanded switches",
    "cuts": "Sudden cuts",
    "alarms": "False alarms",
    "latency": "Added latency by size",
    "resources": "Cost on the robot",
    "detect": "Noticing a lost link",
    "collector": "The collector",
    "handover": "Goals and services",
    "loaded": "Goals and services beside a load",
    "mirrored": "Goals that both sides execute",
    "keeping": "State",
    "hot": "Hot standby",
    "silence": "False takeovers by silence",
}
"""Groups of figures, for people."""
_NUMBERS: Final = ("n", "measured", "must", "aim", "ratio")
_STYLES: Final = {"missed": "red", "must": "yellow", "aim": "green"}


def number(value: float | None, unit: str) -> str:
    """Returns a value with as many digits as it deserves."""
    if value is None:
        return "not measured"
    if unit in ("messages", "alarms"):
        return f"{value:.0f}"
    digits = 2 if abs(value) < 10 else 1 if abs(value) < 100 else 0
    return f"{value:.{digits}f} {unit}"


def limit(figure: Figure, value: float | None) -> str:
    """Returns a limit in words; empty without one."""
    if value is None:
        return ""
    sign = "≥" if figure.at_least else "≤"
    unit = "" if figure.unit in ("messages", "alarms") else f" {figure.unit}"
    return f"{value:g}" if value == 0 else f"{sign} {value:g}{unit}"


def verdict(figure: Figure) -> str:
    """`aim`, `must` or `missed`: the best that was kept; empty when nothing was demanded or measured."""
    must, aim = figure.met(figure.must), figure.met(figure.aim)
    if aim or (must and figure.aim is None):
        return "aim" if aim else "must"
    if must:
        return "must"
    return "" if must is None else "missed"


def table(outcomes: Sequence[GroupResult], priority: Priority) -> Table:
    """Returns all figures of one priority."""
    shown = Table(title=f"Figures, {PRIORITY_WORDS[priority]}", title_justify="left")
    for heading in ("figure", "conditions", "n", "measured", "must", "aim", "kept", "beside it, same run", "ratio"):
        shown.add_column(heading, justify="right" if heading in _NUMBERS else "left")
    for figure in figures(outcomes, priority):
        kept = verdict(figure)
        shown.add_row(
            figure.title, link(figure), str(figure.count), number(figure.value, figure.unit),
            limit(figure, figure.must), limit(figure, figure.aim), f"[{_STYLES[kept]}]{kept}[/]" if kept else "",
            beside(figure), ratio(figure),
        )  # fmt: skip
    return shown


def beside(figure: Figure) -> str:
    """Returns the baseline of the same run; empty without one."""
    return "" if figure.baseline is None else f"{figure.against}: {number(figure.baseline, figure.unit)}"


def ratio(figure: Figure) -> str:
    """Returns the value in multiples of the baseline; empty without one."""
    return "" if figure.ratio is None else f"{figure.ratio:.2f}"


def link(figure: Figure) -> str:
    """Returns the conditions with the tolerance."""
    if figure.tolerance_ms is None:
        return figure.conditions
    return f"{figure.conditions} (tolerance {figure.tolerance_ms} ms)"


def figures(outcomes: Iterable[GroupResult], priority: Priority) -> tuple[Figure, ...]:
    """Returns the figures of one priority, in the order of the outcomes."""
    return tuple(figure for outcome in outcomes if outcome.priority == priority for figure in outcome.figures)
