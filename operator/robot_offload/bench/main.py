"""`python -m robot_offload.bench switch`: measures the switching figures and writes them down.

Nothing here asserts a time: the command ends with 0 when it could measure, whatever came out. The table says what was
demanded and whether it was kept.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from robot_offload.bench import machine
from robot_offload.bench.groups import alarms, commanded, cuts, latency, resources
from robot_offload.bench.plan import FULL, QUICK, Amounts, Order
from robot_offload.bench.results import PRIORITIES, Outcome, Priority
from robot_offload.bench.store import Kept, Store
from robot_offload.bench.table import PRIORITY_WORDS, table
from robot_offload.errors import InputError, RobotOffloadError

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False)


class Group(StrEnum):
    """The groups of figures, each measured in a world of its own."""

    COMMANDED = "commanded"
    CUTS = "cuts"
    ALARMS = "alarms"
    LATENCY = "latency"
    RESOURCES = "resources"


@dataclass(frozen=True)
class Work:
    """How a group is run, and how many steps of the progress bar that is."""

    run: Callable[[Order], Outcome]
    steps: Callable[[Amounts], float]


WORK: Final = {
    Group.COMMANDED: Work(commanded.run, commanded.steps),
    Group.CUTS: Work(cuts.run, cuts.steps),
    Group.ALARMS: Work(alarms.run, alarms.steps),
    Group.LATENCY: Work(latency.run, latency.steps),
    Group.RESOURCES: Work(resources.run, resources.steps),
}
WIDTH: Final = 150
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder of results.json, raw samples (CSV) and all logs.")]
Docs = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Also write benchmarks.md and images/ into this folder.")
]


@app.callback()
def bench() -> None:
    """Measurements of Robot Offload on this machine. Everything is real but the link between the two sides."""


@app.command()
def switch(
    *,
    full: Annotated[
        bool, typer.Option("--full/--quick", help="The numbers of the table (hours), or a look in 8 minutes.")
    ] = False,
    realtime: Annotated[
        bool | None, typer.Option("--realtime/--normal", help="One priority only. Default: both, one after the other.")
    ] = None,
    only: Annotated[list[Group] | None, typer.Option(help="One group of figures only; more than once.")] = None,
    switches: Annotated[int | None, typer.Option(min=1, help="Another number of commanded switches.")] = None,
    cuts: Annotated[int | None, typer.Option(min=1, help="Another number of 2 s cuts of both directions.")] = None,
    minutes: Annotated[float | None, typer.Option(min=0.1, help="Another length of each watch for alarms.")] = None,
    out: Out = Path("out/bench"),
    docs: Docs = None,
    seed: Annotated[int, typer.Option(help="Of the links' chances and of the moments.")] = 1,
    domains: Annotated[str, typer.Option(metavar="ROBOT/CLOUD", help="ROS domains. Default: free ones.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json on standard output at the end.")] = False,
) -> None:
    """Measure commanded switches, sudden cuts, false alarms, latency and cost; print them against their limits.

    Ends with 0 when everything could be measured, whatever came out; 1 when something did not run; 2 for wrong input.
    """
    planned = FULL if full else QUICK
    amounts = replace(
        planned, switches=switches or planned.switches, cuts=cuts or planned.cuts, minutes=minutes or planned.minutes
    )
    wanted: Sequence[Priority] = PRIORITIES if realtime is None else ("realtime" if realtime else "normal",)
    console = _console(stderr=as_json)
    store = Store(out)
    failed = False
    try:
        store.document()  # a folder of something else is refused before hours are spent
        parsed = _domains(domains)
        for priority in wanted:
            for group in only or list(Group):
                order = Order(amounts, priority, out, seed, parsed, lambda _: None)
                failed |= not _measure(console, store, group, order)
    except RobotOffloadError as error:
        raise _stop(error) from error
    _show(console, store, docs)
    if as_json:
        typer.echo(json.dumps(store.document(), indent=2))
    if failed:
        raise typer.Exit(1)


@app.command()
def page(out: Out = Path("out/bench"), docs: Annotated[Path, typer.Option(metavar="DIR")] = Path("docs")) -> None:
    """Write the page and its pictures anew from results that were measured before."""
    try:
        _show(_console(), Store(out), docs)
    except RobotOffloadError as error:
        raise _stop(error) from error


def _measure(console: Console, store: Store, group: Group, order: Order) -> bool:
    """Runs one group and keeps what came out; returns whether it could be measured."""
    load = machine.load()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    work = WORK[group]
    try:
        # Refreshed by hand: a thread of its own would endanger the starting of processes.
        with Progress(*columns, console=console, auto_refresh=False) as progress:
            name = f"{group.value}, {PRIORITY_WORDS[order.priority]}"
            task = progress.add_task(name, total=work.steps(order.amounts))
            progress.refresh()

            def advance(steps: float) -> None:
                progress.advance(task, steps)
                progress.refresh()

            outcome = work.run(replace(order, advance=advance))
    except RobotOffloadError as error:
        for line in error.lines:
            console.print(line, style="red", highlight=False, markup=False, soft_wrap=True)
        return False
    store.put(Kept(outcome, machine.today(), machine.describe(), (load, machine.load()), order.amounts))
    return True


def _show(console: Console, store: Store, docs: Path | None) -> None:
    """The tables, and the page if one is wanted."""
    kept = store.all()
    outcomes = [one.outcome for one in kept]
    for priority in PRIORITIES:
        if any(outcome.priority == priority for outcome in outcomes):
            console.print(table(outcomes, priority))
    console.print(f"Results and raw samples: {store.folder}", highlight=False)
    if docs is not None:
        from robot_offload.bench import page as pages  # noqa: PLC0415 - matplotlib takes a second to import

        console.print(f"Page: {pages.write(kept, docs)}", highlight=False)


def _console(*, stderr: bool = False) -> Console:
    """Standard output, or standard error where results go to the other; wide where nobody looks at a screen."""
    console = Console(stderr=stderr)
    return console if console.is_terminal else Console(stderr=stderr, width=WIDTH)


def _domains(text: str) -> tuple[int, int] | None:
    if not text:
        return None
    numbers = [int(part) for part in text.split("/") if part.isdecimal()]
    if len(numbers) != 2 or max(numbers) > 232 or numbers[0] == numbers[1]:
        raise InputError(f"--domains: {text!r}: write two different numbers from 0 to 232, for example 81/82")
    return numbers[0], numbers[1]


def _stop(error: RobotOffloadError) -> typer.Exit:
    for line in error.lines:
        typer.echo(line, err=True)
    return typer.Exit(error.exit_code)
