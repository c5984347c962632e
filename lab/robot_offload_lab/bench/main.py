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
from robot_offload_lab.bench.groups import detect as detection
from robot_offload_lab.bench.groups import experiment
from robot_offload_lab.bench.plan import FULL, QUICK, Amounts, Order
from robot_offload_lab.bench.results import PRIORITIES, Priority
from robot_offload_lab.bench.session import SWITCH, WIDTH, Group, Session
from robot_offload_lab.bench.store import Store

HELP: Final = (
    "Measure Robot Offload on this machine, beside what one would use instead. Everything is real but the link between "
    "the two sides."
)
EXAMPLES: Final = (
    "robot-offload bench all --quick",
    "robot-offload bench latency --full --out out/latency",
    "robot-offload bench switch --only cuts --cuts 20",
    "robot-offload bench all --quick --docs docs --resume",
)


def _case(known: Sequence[str]) -> Any:
    """An option that picks some cases of a command."""
    return typer.Option(metavar="CASE", help=f"Only this one of {', '.join(known)}; more than once.")


app = typer.Typer(
    help=HELP,
    epilog="\n".join(["\b", "Examples:", *(f"  {example}" for example in EXAMPLES)]),
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
Full = Annotated[bool, typer.Option("--full/--quick", help="The long form (hours for some), or a look in minutes.")]
Realtime = Annotated[bool, typer.Option("--realtime/--normal", help="Priority of agents and nodes.")]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder of results.json, samples (CSV), pictures and logs.")]
Docs = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Also refresh benchmarks.md and images/ in this folder.")
]
Resume = Annotated[bool, typer.Option("--resume", help="Leave out what this folder holds of today, measured alike.")]
Seed = Annotated[int, typer.Option(help="Of the links' chances and of the moments.")]
Domains = Annotated[str, typer.Option(metavar="ROBOT/CLOUD", help="ROS domains. Default: free ones.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print results.json on standard output at the end.")]
OUT: Final = Path("out/bench")


@app.callback()
def bench() -> None:
    """A folder can be measured into again and again: each group replaces its own figures only.

    Ends with 0 when everything could be measured, whatever came out; 1 when something did not run; 2 for wrong input.
    """


@app.command()
def latency(
    *,
    full: Full = False,
    realtime: Realtime = True,
    messages: Annotated[int | None, typer.Option(min=10, help="Another number from each publisher.")] = None,
    case: Annotated[list[str] | None, _case(experiment.CASES)] = None,
    out: Out = OUT,
    docs: Docs = None,
    resume: Resume = False,
    seed: Seed = 1,
    domains: Domains = "",
    as_json: AsJson = False,
) -> None:
    """Latency of ten topics at 10 Hz: one host, bridge, two hosts, robot to cloud; processor time beside it."""
    amounts = _amounts(full)
    order = _order(replace(amounts, messages=messages or amounts.messages), out, seed, domains)
    order = _only(order, case, experiment.CASES)
    _run([Group.EXPERIMENT], _one(realtime), order, docs, resume, as_json)


@app.command()
def lifecycle(
    *,
    full: Full = False,
    realtime: Realtime = True,
    rounds: Annotated[int | None, typer.Option(min=1, help="Another number of rounds in each case.")] = None,
    out: Out = OUT,
    docs: Docs = None,
    resume: Resume = False,
    seed: Seed = 1,
    domains: Domains = "",
    as_json: AsJson = False,
) -> None:
    """Activation and deactivation as a manager sees them: alone, among others, heavy, ten at once, over the link."""
    amounts = _amounts(full)
    order = _order(replace(amounts, rounds=rounds or amounts.rounds), out, seed, domains)
    _run([Group.LIFECYCLE], _one(realtime), order, docs, resume, as_json)


@app.command()
def switch(
    *,
    full: Full = False,
    realtime: Annotated[
        bool | None, typer.Option("--realtime/--normal", help="One priority only. Default: both, one after the other.")
    ] = None,
    only: Annotated[list[Group] | None, typer.Option(help="One group of figures only; more than once.")] = None,
    switches: Annotated[int | None, typer.Option(min=1, help="Another number of commanded switches.")] = None,
    cuts: Annotated[int | None, typer.Option(min=1, help="Another number of 2 s cuts of both directions.")] = None,
    minutes: Annotated[float | None, typer.Option(min=0.1, help="Another length of each watch for alarms.")] = None,
    out: Out = OUT,
    docs: Docs = None,
    resume: Resume = False,
    seed: Seed = 1,
    domains: Domains = "",
    as_json: AsJson = False,
) -> None:
    """Commanded switches, sudden cuts, false alarms, latency by size and cost, against their limits."""
    amounts = _amounts(full)
    amounts = replace(
        amounts, switches=switches or amounts.switches, cuts=cuts or amounts.cuts, minutes=minutes or amounts.minutes
    )
    priorities = PRIORITIES if realtime is None else _one(realtime)
    _run(only or SWITCH, priorities, _order(amounts, out, seed, domains), docs, resume, as_json)


@app.command()
def detect(
    *,
    full: Full = False,
    realtime: Realtime = True,
    cuts: Annotated[int | None, typer.Option(min=1, help="Another number of cuts in each case.")] = None,
    quiet: Annotated[float | None, typer.Option(min=1, metavar="SECONDS", help="Without a cut, before them.")] = None,
    case: Annotated[list[str] | None, _case(detection.CASES)] = None,
    out: Out = OUT,
    docs: Docs = None,
    resume: Resume = False,
    seed: Seed = 1,
    domains: Domains = "",
    as_json: AsJson = False,
) -> None:
    """How soon a lost link is noticed, by standby, heartbeat and link; false alarms; DDS liveliness and bond beside."""
    amounts = _amounts(full)
    amounts = replace(amounts, detections=cuts or amounts.detections, quiet_s=quiet or amounts.quiet_s)
    order = _only(_order(amounts, out, seed, domains), case, detection.CASES)
    _run([Group.DETECT], _one(realtime), order, docs, resume, as_json)


@app.command()
def collector(
    *,
    full: Full = False,
    realtime: Realtime = True,
    seconds: Annotated[float | None, typer.Option(min=0.5, help="Another length of each stage.")] = None,
    out: Out = OUT,
    docs: Docs = None,
    resume: Resume = False,
    seed: Seed = 1,
    domains: Domains = "",
    as_json: AsJson = False,
) -> None:
    """What the collector in front of the consumers adds, and how much passes it, by size and rate."""
    amounts = _amounts(full)
    order = _order(replace(amounts, stage_s=seconds or amounts.stage_s), out, seed, domains)
    _run([Group.COLLECTOR], _one(realtime), order, docs, resume, as_json)


@app.command("all")
def everything(
    *,
    full: Full = False,
    realtime: Realtime = True,
    only: Annotated[list[Group] | None, typer.Option(help="One group of figures only; more than once.")] = None,
    out: Out = OUT,
    docs: Docs = None,
    resume: Resume = False,
    seed: Seed = 1,
    domains: Domains = "",
    as_json: AsJson = False,
) -> None:
    """Everything; with --quick in less than ten minutes on an idle machine."""
    order = _order(_amounts(full), out, seed, domains)
    _run(only or list(Group), _one(realtime), order, docs, resume, as_json)


@app.command()
def page(out: Out = OUT, docs: Annotated[Path, typer.Option(metavar="DIR")] = Path("docs")) -> None:
    """Write the page and its pictures anew from results that were measured before."""
    try:
        Session(_console(), Store(out), docs).show()
    except RobotOffloadError as error:
        raise _stop(error) from error


def _only(order: Order, cases: Sequence[str] | None, known: Sequence[str]) -> Order:
    unknown = [case for case in cases or () if case not in known]
    if unknown:
        raise _stop(InputError(f"--case: there is no {unknown[0]!r}; known are {', '.join(known)}"))
    return replace(order, cases=tuple(cases or ()))


def _amounts(full: bool) -> Amounts:
    return FULL if full else QUICK


def _one(realtime: bool) -> tuple[Priority, ...]:
    return ("realtime",) if realtime else ("normal",)


def _order(amounts: Amounts, out: Path, seed: int, domains: str) -> Order:
    try:
        return Order(amounts, "realtime", out, seed, _domains(domains), lambda _: None)
    except InputError as error:
        raise _stop(error) from error


def _run(
    groups: Sequence[Group],
    priorities: Sequence[Priority],
    order: Order,
    docs: Path | None,
    resume: bool,
    as_json: bool,
) -> None:
    session = Session(_console(stderr=as_json), Store(order.out), docs)
    try:
        try:
            failed = session.run(groups, priorities, order, resume=resume)
        finally:
            session.show()  # also when it was interrupted: what was measured is worth seeing
    except RobotOffloadError as error:
        raise _stop(error) from error
    if as_json:
        typer.echo(json.dumps(session.store.document(), indent=2))
    for line in failed:
        typer.echo(f"Not measured: {line}", err=True)
    if failed:
        raise typer.Exit(1)


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
