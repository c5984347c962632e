"""The command of the bench: `robot-offload bench`, or `python -m robot_offload_lab.bench`.

Nothing here asserts a time: the command ends with 0 when it could measure, whatever the result. The tables state what
was demanded and whether it was kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console

from robot_offload.errors import InputError, RobotOffloadError
from robot_offload_lab.bench.groups import detect, experiment, keeping, lifecycle, silence
from robot_offload_lab.bench.plan import FULL, QUICK, Order, changed
from robot_offload_lab.bench.results import PRIORITIES, Priority
from robot_offload_lab.bench.session import WIDTH, BenchSession, Group
from robot_offload_lab.run.free import parse_domains

EXAMPLES: Final = (
    "robot-offload bench all",
    "robot-offload bench latency --full --out out/latency",
    "robot-offload bench cuts --set cuts=20",
    "robot-offload bench weight --against v0.1.0",
    "robot-offload bench all --docs docs --resume",
)
SETS: Final[dict[str, tuple[Group, ...]]] = {
    "all": tuple(Group),
    "switch": (Group.COMMANDED, Group.CUTS, Group.RESOURCES),
    "handover": (Group.HANDOVER, Group.MIRRORED, Group.KEEPING),
    "hot": (Group.HOT, Group.SILENCE),
    "latency": (Group.EXPERIMENT,),
    "weight": (Group.RESOURCES,),
}
"""Names of several groups together, or of one by its subject."""
NAMES: Final = (*SETS, *(group.value for group in Group if group.value not in SETS))
CASES: Final = {
    Group.EXPERIMENT: experiment.CASES,
    Group.LIFECYCLE: tuple(case.name for case in lifecycle.CASES),
    Group.DETECT: detect.CASES,
    Group.KEEPING: tuple(case.name for case in keeping.CASES),
    Group.SILENCE: tuple(case.name for case in silence.CASES),
}


def bench(
    names: Annotated[list[str], typer.Argument(metavar="NAME...", help=f"What to measure: {', '.join(NAMES)}.")],
    *,
    full: Annotated[bool, typer.Option("--full/--quick", help="Hours for some groups, or a look in minutes.")] = False,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="AMOUNT=NUMBER", help="Another amount, such as cuts=20.")
    ] = None,
    case: Annotated[
        list[str] | None, typer.Option(metavar="CASE", help="Case of a group that has several; more than once.")
    ] = None,
    realtime: Annotated[
        bool | None, typer.Option("--realtime/--normal", help="Priority of agents and nodes; `switch` measures both.")
    ] = None,
    against: Annotated[str, typer.Option(metavar="COMMIT", help="Weigh the agents of this commit beside.")] = "",
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the figures, samples (CSV) and logs.")] = Path(
        "out/bench"
    ),
    docs: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder in which to refresh benchmarks.csv and .md, too."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Skip what was measured today in this form.")] = False,
    seed: Annotated[int, typer.Option(help="Random seed of the links and of the moments of cuts and switches.")] = 1,
    domains: Annotated[
        str, typer.Option(metavar="ROBOT/CLOUD", help="ROS domains of the two sides. Default: free ones.")
    ] = "",
) -> None:
    """Measure Robot Offload on this machine, beside what one would use instead.

    Everything is real but the link between the two sides. A folder can be measured into again and again: each group
    replaces its own figures only. Ends with 0 when everything could be measured, whatever came out; 1 when something
    did not run; 2 for wrong input.
    """
    try:
        groups, cases = _groups(names), tuple(case or ())
        _check_cases(cases, groups)
        amounts = changed(FULL if full else QUICK, settings or ())
        order = Order(amounts, "realtime", out, seed, parse_domains(domains), cases, against)
        session = BenchSession(_console(), out, docs)
        try:
            failed = session.run(groups, _priorities(names, realtime), order, resume=resume)
        finally:
            session.show()  # also when it was interrupted: what was measured is worth seeing
    except RobotOffloadError as error:
        for line in error.lines:
            typer.echo(line, err=True)
        raise typer.Exit(error.exit_code) from error
    for line in failed:
        typer.echo(f"Not measured: {line}", err=True)
    if failed:
        raise typer.Exit(1)


def _groups(names: Sequence[str]) -> list[Group]:
    """Return the groups of these names, each once."""
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        raise InputError(f"NAME: there is no {unknown[0]!r}; known are {', '.join(NAMES)}")
    return list(dict.fromkeys(group for name in names for group in (SETS[name] if name in SETS else (Group(name),))))


def _priorities(names: Sequence[str], realtime: bool | None) -> tuple[Priority, ...]:
    if realtime is None:
        return PRIORITIES if list(names) == ["switch"] else ("realtime",)
    return ("realtime",) if realtime else ("normal",)


def _check_cases(cases: Sequence[str], groups: Sequence[Group]) -> None:
    """Refuse a case that none of the groups has."""
    known = [name for group in groups for name in CASES.get(group, ())]
    unknown = [case for case in cases if case not in known]
    if unknown:
        raise InputError(f"--case: there is no {unknown[0]!r}; known are {', '.join(known) or 'none'}")


def _console() -> Console:
    """Return a console on standard output, wide unless it is a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)
