"""`python -m robot_offload_lab.bench.link_table`: what links of several kinds carry.

Both agents run between two network namespaces, with one load as a required input. The link is changed while everything
runs, so each kind takes seconds. The rows are kept in `links.json`, so that a table can be measured in several runs;
with `--docs` the file beside the page is rewritten from all of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final

import typer

from robot_offload.errors import InputError, RobotOffloadError
from robot_offload_lab.bench import machine
from robot_offload_lab.bench.across import AcrossHosts
from robot_offload_lab.bench.analysis import links
from robot_offload_lab.bench.analysis.links import Cell, Row, TopicLoad
from robot_offload_lab.bench.resource import BenchCase, Sensor
from robot_offload_lab.bench.world import Evidence, Setting
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.two_hosts import TwoHosts

FILE: Final = "links.json"
TABLE: Final = Path("explanation/links.csv")
SETTLE_S: Final = 4.0
"""Time after each change of the link until its capacity is known."""
MAX_AGE_MS: Final = 500
QUEUE_MS: Final = 100
"""Queue in front of the limited rate, as in a home router."""
TOLERANCE_MS: Final = 150
DOMAINS: Final = (1, 2)
"""Arbitrary, because each side is a host of its own."""
SWITCHING: Final = (
    ("lease", "320ms"), ("maxCommandAge", "250ms"),
    ("holdDown", {"initial": "100ms", "max": "300ms", "flapWindow": "1s"}),
)  # fmt: skip
"""For round trips of 100 ms; a takeover shows as a short absence from the cloud, not as half of the observation."""


def case(load: TopicLoad) -> BenchCase:
    """Return the case in which a load is a required input, thinned to what the link carries, newest first."""
    settings = (("minRate", 3), ("latest", True))
    return BenchCase(
        f"links-{load.name}", LinkOptions(delay="5ms"), tolerance_ms=TOLERANCE_MS, cloud_rate_hz=20.0,
        sensors=(Sensor("load", (load.size,), MAX_AGE_MS, settings),), sensor_rate_hz=load.rate_hz, switching=SWITCHING,
    )  # fmt: skip


def measure(
    loads: Sequence[TopicLoad], cells_of: Callable[[str], Sequence[Cell]], seconds: float, out: Path,
    known: Sequence[Row], kept: Callable[[Row], None], limit_s: float,
) -> bool:  # fmt: skip
    """Measure what is not known yet; return whether everything was measured.

    Args:
        loads: what is published.
        cells_of: returns the links of a load, by its name.
        seconds: of each observation.
        out: folder for the runs' files.
        known: rows that exist already.
        kept: called with each row as soon as its load is done.
        limit_s: seconds after which no further load or link is begun.

    Raises:
        InputError: this machine cannot make two hosts.
    """
    refusal = TwoHosts.refusal()
    if refusal:
        raise InputError(f"no link can be emulated between two hosts: {refusal}")
    there, began_s = {(one.load, one.cell) for one in known}, steady_s()
    for load in loads:
        missing = [cell for cell in cells_of(load.name) if (load.name, cell) not in there]
        if missing and steady_s() - began_s < limit_s:
            for row in _run(load, missing, seconds, out, began_s + limit_s):
                kept(row)
                there.add((load.name, row.cell))
    return all((load.name, cell) in there for load in loads for cell in cells_of(load.name))


def _run(load: TopicLoad, cells: Sequence[Cell], seconds: float, out: Path, until_s: float) -> list[Row]:
    windows: list[tuple[Cell, Interval, float]] = []
    setting = Setting(out / "runs" / f"links-{load.name}", realtime=True, domains=DOMAINS, beats=False)
    with AcrossHosts(case(load), setting) as world:
        for cell in cells:
            if steady_s() > until_s and windows:
                break
            world.wire.set(
                delay_ms=cell.round_trip_ms / 2 - 5, loss=cell.loss_percent / 100, rate_kbit_s=cell.rate_mbit * 1000,
                queue_ms=QUEUE_MS,
            )  # fmt: skip
            world.rest(SETTLE_S)
            start_s = steady_s()
            world.rest(seconds)
            windows.append((cell, Interval(start_s, steady_s()), machine.load()))
        evidence = world.finish()
    return [_row(load, cell, window, evidence, average) for cell, window, average in windows]


def _row(load: TopicLoad, cell: Cell, window: Interval, evidence: Evidence, average: float) -> Row:
    assert evidence.inputs is not None
    arrivals = [arrival for found in evidence.inputs.outputs.values() for arrival in found]
    found = (machine.today(), machine.words(machine.describe()), round(average, 1))
    return links.row(load, cell, window, arrivals, evidence.robot, found)


def read(out: Path) -> list[Row]:
    """Return the rows that are kept in a folder.

    Raises:
        InputError: the file has another content.
    """
    path = out / FILE
    return links.decode(path.read_text(encoding="utf-8"), str(path)) if path.exists() else []


def keep(out: Path, rows: Sequence[Row]) -> list[Row]:
    """Add rows to those of a folder; return all."""
    found = links.merged(read(out), rows)
    out.mkdir(parents=True, exist_ok=True)
    (out / FILE).write_text(links.encode(found), encoding="utf-8")
    return found


def write_table(docs: Path, rows: Sequence[Row]) -> Path:
    """Write all rows beside the page about links; return the file."""
    path = docs / TABLE
    path.write_text(links.table(rows), encoding="utf-8")
    return path


def fresh(rows: Sequence[Row]) -> list[Row]:
    """Return today's rows, which `--resume` does not measure again."""
    return [row for row in rows if row.date == time.strftime("%Y-%m-%d", time.gmtime())]


def chosen(loads: Sequence[TopicLoad], names: Sequence[str]) -> list[TopicLoad]:
    """Return the loads of these names; without names all.

    Raises:
        InputError: there is no such load.
    """
    unknown = [name for name in names if name not in {load.name for load in loads}]
    if unknown:
        raise InputError(f"--load: there is no {unknown[0]!r}; known are {', '.join(load.name for load in loads)}")
    return [replace(load) for load in loads if not names or load.name in names]


def main(
    *,
    full: Annotated[
        bool,
        typer.Option("--full/--quick", help="All kinds of link that are wide enough for a load, or a share of them."),
    ] = False,
    load: Annotated[list[str] | None, typer.Option(help="Load to measure; more than once. Default: all.")] = None,
    seconds: Annotated[float, typer.Option(min=2, help="Seconds of each observation.")] = 10.0,
    limit: Annotated[
        float,
        typer.Option(min=30, metavar="SECONDS", help="Seconds after which no other link is begun; --resume goes on."),
    ] = 240.0,
    resume: Annotated[bool, typer.Option("--resume", help="Skip what this folder has from today.")] = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of links.json and logs.")] = Path("out/bench"),
    docs: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the docs, to refresh explanation/links.csv.")
    ] = None,
) -> None:
    """Measure what links carry of images and point clouds: delivered, age, time in the cloud, false alarms. Needs root.

    Ends with 0 when all of the table is there, 3 when the limit came first.
    """

    def keep_and_print(row: Row) -> None:
        keep(out, [row])
        typer.echo(links.table([row]).splitlines()[1])

    try:
        known = fresh(read(out)) if resume else []
        cells_of = links.wide_enough if full else links.SOME.__getitem__
        done = measure(chosen(links.LOADS, load or ()), cells_of, seconds, out, known, keep_and_print, limit)
        if docs is not None:
            typer.echo(f"Table: {write_table(docs, read(out))}")
    except RobotOffloadError as error:
        for line in error.lines:
            typer.echo(line, err=True)
        raise typer.Exit(error.exit_code) from error
    if not done:
        raise typer.Exit(3)


if __name__ == "__main__":
    typer.run(main)
