"""The commands of the bench: `robot-offload bench ...`, or `python -m robot_offload_lab.bench ...`.

Nothing here asserts a time: a command ends with 0 when it could measure, whatever came out. The tables say what was
demanded and whether it was kept.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console

from robot_offload.errors import InputError, RobotOffloadError
from robot_offload_lab.bench import link_table
from robot_offload_lab.bench.analysis import links
from robot_offload_lab.bench.groups import detect as detection
from robot_offload_lab.bench.groups import experiment, keeping, silence
from robot_offload_lab.bench.groups import lifecycle as transitions
from robot_offload_lab.bench.options import OUT, Common, FolderOfDocs, Out, measurement
from robot_offload_lab.bench.plan import Amounts
from robot_offload_lab.bench.results import PRIORITIES, Priority
from robot_offload_lab.bench.session import HANDOVER, HOT, SWITCH, WIDTH, BenchSession, Group
from robot_offload_lab.bench.store import Store

HELP: Final = (
    "Measure Robot Offload on this machine, beside what one would use instead. Everything is real but the link between "
    "the two sides."
)
EXAMPLES: Final = (
    "robot-offload bench all --quick",
    "robot-offload bench latency --full --out out/latency",
    "robot-offload bench switch --only cuts --cuts 20",
    "robot-offload bench links --full --resume --docs docs",
    "robot-offload bench weight --seconds 60 --against v0.1.0",
    "robot-offload bench all --quick --docs docs --resume",
)
STATE_CASES: Final = tuple(case.name for case in keeping.CASES)
SILENCE_CASES: Final = tuple(case.name for case in silence.CASES)
LIFECYCLE_CASES: Final = tuple(case.name for case in transitions.CASES)
app = typer.Typer(
    help=HELP,
    epilog="\n".join(["\b", "Examples:", *(f"  {example}" for example in EXAMPLES)]),
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
Only = Annotated[list[Group] | None, typer.Option(help="Group of figures to measure; more than once. Default: all.")]


def _case(known: Sequence[str]) -> Any:
    """Returns an option that picks some cases of a command."""
    return typer.Option(metavar="CASE", help=f"Case to measure: {', '.join(known)}; more than once. Default: all.")


@app.callback()
def bench() -> None:
    """A folder can be measured into again and again: each group replaces its own figures only.

    Ends with 0 when everything could be measured, whatever came out; 1 when something did not run; 2 for wrong input.
    """


@app.command()
@measurement
def latency(
    common: Common,
    *,
    messages: Annotated[int | None, typer.Option(min=10, help="Messages of each publisher.")] = None,
    case: Annotated[list[str] | None, _case(experiment.CASES)] = None,
) -> None:
    """Latency of ten topics at 10 Hz: one host, bridge, two hosts, robot to cloud; processor time beside it."""
    amounts = replace(common.amounts, messages=messages or common.amounts.messages)
    _run(common, [Group.EXPERIMENT], amounts, case, experiment.CASES)


@app.command()
@measurement
def lifecycle(
    common: Common,
    *,
    rounds: Annotated[int | None, typer.Option(min=1, help="Rounds in each case.")] = None,
    case: Annotated[list[str] | None, _case(LIFECYCLE_CASES)] = None,
) -> None:
    """Activation and deactivation as a manager sees them: alone, among others, heavy, ten at once, over the link."""
    amounts = replace(common.amounts, rounds=rounds or common.amounts.rounds)
    _run(common, [Group.LIFECYCLE], amounts, case, LIFECYCLE_CASES)


@app.command()
@measurement
def switch(
    common: Common,
    *,
    only: Only = None,
    switches: Annotated[int | None, typer.Option(min=1, help="Commanded switches.")] = None,
    cuts: Annotated[int | None, typer.Option(min=1, help="Cuts of both directions, 2 s each.")] = None,
    minutes: Annotated[float | None, typer.Option(min=0.1, help="Minutes of each watch for false alarms.")] = None,
) -> None:
    """Commanded switches, sudden cuts, false alarms, latency by size and cost, against their limits."""
    chosen = common.amounts
    amounts = replace(
        chosen,
        switches=switches or chosen.switches,
        cuts=cuts or chosen.cuts,
        minutes=minutes or chosen.minutes,
    )
    priorities = PRIORITIES if common.realtime is None else (common.priority,)
    _run(common, only or SWITCH, amounts, priorities=priorities)


@app.command()
@measurement
def detect(
    common: Common,
    *,
    cuts: Annotated[int | None, typer.Option(min=1, help="Cuts in each case.")] = None,
    quiet: Annotated[
        float | None, typer.Option(min=1, metavar="SECONDS", help="Seconds to watch before the first cut.")
    ] = None,
    case: Annotated[list[str] | None, _case(detection.CASES)] = None,
) -> None:
    """How soon a lost link is noticed, by standby, heartbeat and link; false alarms; DDS liveliness and bond beside."""
    chosen = common.amounts
    amounts = replace(chosen, detections=cuts or chosen.detections, quiet_s=quiet or chosen.quiet_s)
    _run(common, [Group.DETECT], amounts, case, detection.CASES)


@app.command()
@measurement
def collector(
    common: Common,
    *,
    seconds: Annotated[float | None, typer.Option(min=0.5, help="Seconds of each stage of size and rate.")] = None,
) -> None:
    """What the collector in front of the consumers adds, and how much passes it, by size and rate."""
    _run(common, [Group.COLLECTOR], replace(common.amounts, stage_s=seconds or common.amounts.stage_s))


@app.command()
@measurement
def handover(
    common: Common,
    *,
    only: Only = None,
    switches: Annotated[int | None, typer.Option(min=1, help="Commanded switches, 3 goals alive at each.")] = None,
    cuts: Annotated[int | None, typer.Option(min=1, help="Sudden cuts, 3 goals alive at each.")] = None,
    mirror_cuts: Annotated[int | None, typer.Option(min=1, help="Cuts with goals that both sides execute.")] = None,
    state_cuts: Annotated[int | None, typer.Option(min=1, help="Cuts with snapshots of each size.")] = None,
    case: Annotated[list[str] | None, _case(STATE_CASES)] = None,
) -> None:
    """Goals, calls and state through switches, cuts and a killed relay: idle, beside a load, Hot with mirrors."""
    chosen = common.amounts
    amounts = replace(
        chosen,
        switches=switches or chosen.switches,
        cuts=cuts or chosen.cuts,
        mirror_cuts=mirror_cuts or chosen.mirror_cuts,
        state_cuts=state_cuts or chosen.state_cuts,
    )
    _run(common, only or HANDOVER, amounts, case, STATE_CASES)


@app.command()
@measurement
def hot(
    common: Common,
    *,
    only: Only = None,
    switches: Annotated[int | None, typer.Option(min=2, help="Commanded switches.")] = None,
    cuts: Annotated[int | None, typer.Option(min=1, help="Sudden cuts, half a second each.")] = None,
    minutes: Annotated[float | None, typer.Option(min=0.1, help="Minutes of each watch for false takeovers.")] = None,
    case: Annotated[list[str] | None, _case(SILENCE_CASES)] = None,
) -> None:
    """Hot standby: gaps of commanded switches and sudden cuts; false takeovers by silence on a bad link."""
    chosen = common.amounts
    amounts = replace(
        chosen,
        hot_switches=switches or chosen.hot_switches,
        hot_cuts=cuts or chosen.hot_cuts,
        hot_minutes=minutes or chosen.hot_minutes,
    )
    _run(common, only or HOT, amounts, case, SILENCE_CASES)


@app.command()
@measurement
def weight(
    common: Common,
    *,
    seconds: Annotated[float | None, typer.Option(min=1, help="Seconds of each observation.")] = None,
    against: Annotated[str, typer.Option(metavar="COMMIT", help="Weigh the agents of this commit beside.")] = "",
) -> None:
    """Processor time and memory of both agents with three topics at 20 Hz: in all, by message, by further topic."""
    amounts = replace(common.amounts, resources_s=seconds or common.amounts.resources_s)
    _run(common, [Group.RESOURCES], amounts, against=against)


@app.command("links")
def carried(
    *,
    full: Annotated[
        bool,
        typer.Option("--full/--quick", help="All kinds of link that are wide enough for a load, or a share of them."),
    ] = False,
    load: Annotated[list[str] | None, _case([one.name for one in links.LOADS])] = None,
    seconds: Annotated[float, typer.Option(min=2, help="Seconds of each observation.")] = 10.0,
    limit: Annotated[
        float, typer.Option(min=30, metavar="SECONDS", help="Begin no other link after so long; --resume goes on.")
    ] = 240.0,
    resume: Annotated[bool, typer.Option("--resume", help="Skip what this folder has from today.")] = False,
    out: Out = OUT,
    docs: FolderOfDocs = None,
) -> None:
    """What links carry of images and point clouds: delivered, age, time in the cloud, false alarms. Needs root.

    Ends with 0 when all of the table is there, 3 when the limit came first.
    """
    try:
        known = link_table.fresh(link_table.read(out)) if resume else []
        loads = link_table.chosen(links.LOADS, load or ())
        done = link_table.measure(
            loads, links.wide_enough if full else links.SOME.__getitem__, seconds, out, known,
            lambda row: _show_row(out, row), limit,
        )  # fmt: skip
        if docs is not None:
            typer.echo(f"Page: {link_table.write_page(docs, link_table.read(out))}")
    except RobotOffloadError as error:
        raise _stop(error) from error
    if not done:
        raise typer.Exit(3)


def _show_row(out: Path, row: links.Row) -> None:
    """Keeps a row and prints it."""
    link_table.keep(out, [row])
    typer.echo(links.line(row))


@app.command("all")
@measurement
def everything(common: Common, *, only: Only = None) -> None:
    """Everything; with --quick in some fifteen minutes on an idle machine."""
    _run(common, only or list(Group), common.amounts)


@app.command()
def page(
    out: Out = OUT, docs: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the page.")] = Path("docs")
) -> None:
    """Write the page and its pictures anew from results that were measured before."""
    try:
        BenchSession(_console(), Store(out), docs).show()
    except RobotOffloadError as error:
        raise _stop(error) from error


def _run(
    common: Common,
    groups: Sequence[Group],
    amounts: Amounts,
    cases: Sequence[str] | None = None,
    known: Sequence[str] = (),
    priorities: Sequence[Priority] = (),
    against: str = "",
) -> None:
    """Measures, shows what there is, and ends the command with the code that its help names."""
    try:
        _check_cases(cases or (), known)
        order = replace(common.order(amounts, cases or ()), against=against)
        session = BenchSession(_console(stderr=common.as_json), Store(common.out), common.docs)
        try:
            failed = session.run(groups, priorities or (common.priority,), order, resume=common.resume)
        finally:
            session.show()  # also when it was interrupted: what was measured is worth seeing
    except RobotOffloadError as error:
        raise _stop(error) from error
    if common.as_json:
        typer.echo(json.dumps(session.store.document(), indent=2))
    for line in failed:
        typer.echo(f"Not measured: {line}", err=True)
    if failed:
        raise typer.Exit(1)


def _check_cases(cases: Sequence[str], known: Sequence[str]) -> None:
    """Refuses a case that the command does not have."""
    unknown = [case for case in cases if case not in known]
    if unknown:
        raise InputError(f"--case: there is no {unknown[0]!r}; known are {', '.join(known)}")


def _console(*, stderr: bool = False) -> Console:
    """Returns a console on standard output, or on standard error if results go to the other. Wide unless a terminal."""
    console = Console(stderr=stderr)
    return console if console.is_terminal else Console(stderr=stderr, width=WIDTH)


def _stop(error: RobotOffloadError) -> typer.Exit:
    """Prints what is wrong; returns the end of the command with the error's exit code."""
    for line in error.lines:
        typer.echo(line, err=True)
    return typer.Exit(error.exit_code)
