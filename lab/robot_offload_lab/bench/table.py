"""Figures as text: for the terminal, and the table of docs/benchmarks.md. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

from rich.table import Table

from robot_offload_lab.bench.results import Priority
from robot_offload_lab.bench.rows import Row, figures

PRIORITY_WORDS: Final[dict[Priority, str]] = {"realtime": "real-time priority", "normal": "normal priority"}
TITLES: Final = {
    "experiment": "Ten topics at 10 Hz",
    "lifecycle": "Activation and deactivation",
    "commanded": "Commanded switches",
    "cuts": "Sudden cuts",
    "resources": "Cost on the robot",
    "detect": "Noticing a lost link",
    "handover": "Goals and services",
    "mirrored": "Goals that both sides execute",
    "keeping": "State",
    "hot": "Hot standby",
    "silence": "False takeovers by silence",
}
"""Groups of figures, for people."""
HEADLINES: Final = {
    "commanded": ("gap_p99", "faults"),
    "cuts": ("gap_both_p99", "gap_up_p99", "gap_down_p99", "heal_2s_p90", "stale", "after_lease", "cloud_share"),
    "hot": ("gap_p99", "change_longest", "faults"),
    "silence": ("takeovers", "takeovers_reliable", "takeovers_best-effort"),
    "detect": (
        "warm_0_noticed_p50", "warm_1_noticed_p50", "warm_2_noticed_p50", "warm_3_noticed_p50", "bad_0_alarms",
        "bad_1_alarms", "bad_2_alarms", "bad_3_alarms",
    ),
    "handover": (
        "faults", "accepted_robot", "accepted_cloud", "gap_commanded", "gap_cut", "call_robot_p50", "call_cloud_p50",
    ),
    "mirrored": ("gap_cut",),
    "keeping": ("age_state-1KiB", "age_state-1MiB"),
    "experiment": ("one_host_p50", "two_hosts_added_p50", "zenoh_added_p50", "zenoh_added_p99", "topics_added_p50"),
    "lifecycle": ("alone_activate_p50", "heavy_activate_p50", "together_activate_p50"),
    "resources": ("cpu_robot", "pss_robot", "cpu_cloud", "pss_cloud", "cpu_topic"),
}  # fmt: skip
"""Group -> the figures on the page, in its order. All others are in the CSV file only."""
BEGIN: Final = "<!-- figures: written by `make bench`; changes between these lines are lost -->\n"
END: Final = "<!-- end of the figures -->\n"
_NUMBERS: Final = ("n", "measured", "must", "aim")
_STYLES: Final = {"missed": "red", "must": "yellow", "aim": "green"}
_COUNTED: Final = ("messages", "alarms")


def number(value: str, unit: str) -> str:
    """Return a value with a suitable number of digits."""
    if not value:
        return "not measured"
    amount = float(value)
    if unit in _COUNTED:
        return f"{amount:.0f}"
    digits = 2 if abs(amount) < 10 else 1 if abs(amount) < 100 else 0
    return f"{amount:.{digits}f} {unit}"


def limit(row: Row, name: Literal["must", "aim"]) -> str:
    """Return a limit in words; empty without one."""
    if not row[name]:
        return ""
    unit = "" if row["unit"] in _COUNTED else f" {row['unit']}"
    return "0" if float(row[name]) == 0 else f"{'≥' if row['at_least'] else '≤'} {float(row[name]):g}{unit}"


def beside(row: Row) -> str:
    """Return the baseline measured in the same run; empty without one."""
    return f"{row['against']}: {number(row['baseline'], row['unit'])}" if row["baseline"] else ""


def table(found: Iterable[Row], priority: Priority) -> Table:
    """Return all figures of one priority."""
    shown = Table(title=f"Figures, {PRIORITY_WORDS[priority]}", title_justify="left")
    for heading in ("figure", "conditions", "n", "measured", "must", "aim", "kept", "beside it, same run", "remarks"):
        shown.add_column(heading, justify="right" if heading in _NUMBERS else "left")
    for row in figures(found):
        if row["priority"] == priority:
            kept = row["kept"]
            shown.add_row(
                row["title"], row["conditions"], row["count"], number(row["value"], row["unit"]),
                limit(row, "must"), limit(row, "aim"),
                f"[{_STYLES[kept]}]{kept}[/]" if kept else "", beside(row), row["note"],
            )  # fmt: skip
    return shown


def page(found: Iterable[Row]) -> str:
    """Return the figures of the page as one table of Markdown."""
    known = {(row["group"], row["name"], row["form"], row["priority"]): row for row in figures(found)}
    lines = [
        "| figure | conditions | n | measured | must / aim | kept | beside it | measured on |",
        "|---|---|--:|--:|--:|---|---|---|",
    ]
    for group, names in HEADLINES.items():
        there = [row for name in names if (row := _newest(known, group, name))]
        lines += [f"| **{TITLES[group]}** | | | | | | | |"] if there else []
        lines += [_line(row) for row in there]
    return "\n".join(lines) + "\n"


def with_table(text: str, found: Iterable[Row]) -> str:
    """Return a page with the table between its two marker lines, or at its end if it lacks them."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    return f"{before if begin and end else text}{BEGIN}\n{page(found)}\n{END}{after}"


def _newest(known: dict[tuple[str, str, str, str], Row], group: str, name: str) -> Row | None:
    """Return a figure, of the long form if possible, with real-time priority if possible."""
    keys = [(group, name, form, priority) for priority in PRIORITY_WORDS for form in ("long", "short", "own")]
    return next((known[key] for key in keys if key in known), None)


def _line(row: Row) -> str:
    limits = " / ".join(filter(None, (limit(row, "must"), limit(row, "aim"))))
    cells = (
        row["title"], row["conditions"], row["count"], f"**{number(row['value'], row['unit'])}**", limits, row["kept"],
        beside(row), f"{row['date']}, {row['commit']}",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"
