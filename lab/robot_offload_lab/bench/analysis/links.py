"""What links of several kinds carry of images and point clouds: cells of a table. Pure."""

from __future__ import annotations

import csv
import io
import itertools
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from robot_offload.errors import InputError
from robot_offload_lab.bench.analysis.alarms import QuietStretch, leaves
from robot_offload_lab.bench.analysis.share import cloud_share
from robot_offload_lab.bench.observed import Observation, only
from robot_offload_lab.bench.results import at_or_none
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import Arrival, PlacementChange

SCHEMA: Final = "robotoffload.dev/bench-links/v1"
BEATS: Final = ("HeartbeatLost", "CloudControlSilent", "PulseSilent")
"""Reasons that the beats give: on a link that is there each is a false alarm."""


@dataclass(frozen=True, order=True)
class Cell:
    """One kind of link.

    Attributes:
        rate_mbit: the rate at which it drains, each way.
        round_trip_ms: without any queue.
        loss_percent: packets lost at random each way.
    """

    rate_mbit: int
    round_trip_ms: int
    loss_percent: float


@dataclass(frozen=True)
class TopicLoad:
    """What is published: `size` bytes at `rate_hz`."""

    name: str
    title: str
    size: int
    rate_hz: float

    @property
    def mbit_s(self) -> float:
        """The rate that it needs of a link."""
        return self.size * 8 * self.rate_hz / 1e6


@dataclass(frozen=True)
class Row:
    """One load over one kind of link.

    Attributes:
        load: its name.
        cell: of the link.
        seconds: of the observation.
        delivered: share of the published messages that arrived in the cloud.
        p50_ms, p99_ms: ages at arrival; None where nothing arrived.
        cloud: share of the time with the cloud in charge, the load being a required input; after it was chosen once.
        takeovers: how often the robot took over.
        alarms: of these, for a reason of the beats.
        reasons: of the takeovers.
        date, machine, load_average: of the measurement.
    """

    load: str
    cell: Cell
    seconds: float
    delivered: float
    p50_ms: float | None
    p99_ms: float | None
    cloud: float
    takeovers: int
    alarms: int
    reasons: tuple[str, ...]
    date: str
    machine: str
    load_average: float


RATES: Final = (5, 20, 100)
ROUND_TRIPS: Final = (10, 40, 100)
LOSSES: Final = (0.0, 0.1, 1.0, 3.0)
ALL: Final = tuple(Cell(*words) for words in itertools.product(RATES, ROUND_TRIPS, LOSSES))
NEAR: Final = tuple(Cell(100, *words) for words in itertools.product((10, 40), LOSSES))
NARROW: Final = (
    Cell(20, 10, 0.0), Cell(20, 10, 1.0), Cell(20, 40, 0.1), Cell(20, 40, 3.0), Cell(5, 40, 0.0), Cell(5, 40, 1.0),
)  # fmt: skip
"""A share of the 24 narrower kinds, for what they can carry."""
FAR: Final = tuple(Cell(100, 100, loss) for loss in LOSSES)
LOADS: Final = (
    TopicLoad("raw", "raw VGA image, 0.92 MB", 640 * 480 * 3, 10.0),
    TopicLoad("compressed", "compressed image, 50 kB", 50_000, 10.0),
    TopicLoad("cloud", "point cloud, 1 MB", 1_000_000, 10.0),
    TopicLoad("compressed-cloud", "compressed point cloud, 150 kB", 150_000, 10.0),
)
SOME: Final = {
    "raw": (*NEAR, *FAR), "compressed": (*NEAR, *NARROW, *FAR), "cloud": (*NEAR, *FAR),
    "compressed-cloud": (*NEAR, *NARROW[:4], *FAR),
}  # fmt: skip
"""What a day's table has: raw loads (74 to 80 Mbit/s) only over links that could carry them."""


def row(
    load: TopicLoad, cell: Cell, window: Interval, arrivals: Iterable[Arrival], robot: Sequence[Observation],
    found: tuple[str, str, float],
) -> Row:  # fmt: skip
    """Return what one observation gave.

    Args:
        load: what was published.
        cell: the link.
        window: of the observation.
        arrivals: in the cloud.
        robot: of the witness on the robot.
        found: date, machine and load of the machine.
    """
    ages_ms = [(a.t_s - a.sent_t_s) * 1e3 for a in arrivals if window.start_s <= a.t_s <= window.end_s]
    left = leaves(QuietStretch(window.start_s, window.end_s, tuple(robot)))
    seconds = window.end_s - window.start_s
    return Row(
        load.name, cell, round(seconds, 1), min(1.0, round(len(ages_ms) / (seconds * load.rate_hz), 3)),
        _rounded(at_or_none(ages_ms, 0.5)), _rounded(at_or_none(ages_ms, 0.99)),
        round(cloud_share(only(PlacementChange, robot), [window]) or 0.0, 3), len(left),
        sum(leave.reason in BEATS for leave in left), tuple(leave.reason for leave in left), *found,
    )  # fmt: skip


def _rounded(value_ms: float | None) -> float | None:
    return None if value_ms is None else round(value_ms, 1)


def encode(rows: Iterable[Row]) -> str:
    """Return the file of the rows."""
    return json.dumps({"schema": SCHEMA, "rows": [asdict(one) for one in rows]}, indent=1) + "\n"


def decode(text: str, source: str) -> list[Row]:
    """Read the file of the rows.

    Raises:
        InputError: the text is something else.
    """
    try:
        document = json.loads(text)
        if document["schema"] != SCHEMA:
            raise ValueError(f"schema {document['schema']!r}")
        return [_row(values) for values in document["rows"]]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{source}: {error}; remove it to begin anew") from error


def _row(values: dict[str, Any]) -> Row:
    return Row(**values | {"cell": Cell(**values["cell"]), "reasons": tuple(values["reasons"])})


def merged(old: Iterable[Row], new: Iterable[Row]) -> list[Row]:
    """Return the newest row of each load and cell, in the order of the table."""
    by_key = {(one.load, one.cell): one for one in (*old, *new)}
    names = [load.name for load in LOADS]
    return sorted(by_key.values(), key=lambda one: (names.index(one.load), one.cell))


# -- as text ----------------------------------------------------------------------------------------------------------


COLUMNS: Final = (
    "load", "rate_mbit_s", "round_trip_ms", "loss_percent", "delivered_percent", "age_p50_ms", "age_p99_ms",
    "in_cloud_percent", "takeovers", "reasons", "false_alarms", "date", "machine", "load_average",
)  # fmt: skip
RECKONED: Final = "reckoned: at most"
"""The reason of a row that was not measured: its rate cannot carry the load."""


def table(rows: Sequence[Row]) -> str:
    """Return the rows of each load as CSV with a header, and a reckoned row for each rate that cannot carry it."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for load in LOADS:
        mine = [one for one in rows if one.load == load.name]
        writer.writerows(map(_cells, mine))
        writer.writerows(_too_narrow(load, mine) if mine else [])
    return text.getvalue()


def _too_narrow(load: TopicLoad, measured: Sequence[Row]) -> list[list[object]]:
    """Return a row for each rate that cannot carry a load, by reckoning, where none was measured."""
    wide, known = {cell.rate_mbit for cell in wide_enough(load.name)}, {one.cell.rate_mbit for one in measured}
    return [
        [load.name, rate, "", "", round(rate / load.mbit_s * 100), "", "", "", "", RECKONED, "", "", "", ""]
        for rate in RATES
        if rate not in wide | known
    ]


def wide_enough(name: str) -> tuple[Cell, ...]:
    """Return the kinds of link whose rate could carry all of a load."""
    (load,) = [one for one in LOADS if one.name == name]
    return tuple(cell for cell in ALL if cell.rate_mbit >= load.mbit_s)


def _cells(one: Row) -> list[object]:
    """Return the cells of a measured row."""
    cell, why = one.cell, ", ".join(sorted(set(one.reasons)))
    return [
        one.load, cell.rate_mbit, cell.round_trip_ms, f"{cell.loss_percent:g}", f"{one.delivered * 100:.0f}",
        *("" if age is None else f"{age:.0f}" for age in (one.p50_ms, one.p99_ms)), f"{one.cloud * 100:.0f}",
        one.takeovers, why, one.alarms, one.date, one.machine, one.load_average,
    ]  # fmt: skip
