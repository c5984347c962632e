"""`robot-offload blackbox`: what an agent took in and decided, run again step by step."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.cli.app import example_text
from robot_offload.errors import InputError
from robot_offload_lab.blackbox import ring, story
from robot_offload_lab.blackbox.cut import cut
from robot_offload_lab.blackbox.decided import DecidedMoment, Totals, moments
from robot_offload_lab.blackbox.story import Asks

EXAMPLES = (
    "robot-offload blackbox replay ~/.local/state/robot-offload/UID/blackbox",
    "robot-offload blackbox replay switch.box --states --around 14:03:20",
    "robot-offload blackbox cut /var/lib/robot-offload/blackbox --around 14:03:20 -o switch.box",
    "robot-offload blackbox to-test switch.box --name leaves_too_late --wrong 14:03:20.512 -o test_leaves_too_late.py",
)
BEFORE_S, AFTER_S = 20.0, 10.0

app = typer.Typer(
    help="Replay what an agent took in and decided: its black box.", epilog=example_text(EXAMPLES), no_args_is_help=True
)

Place = Annotated[Path, typer.Argument(metavar="FILE", help="A black box: a file, or the folder of an agent's ring.")]
Around = Annotated[str, typer.Option("--around", metavar="HH:MM:SS", help="Only this time of day, and what is near.")]
Before = Annotated[float, typer.Option("--before", metavar="SECONDS", help="How much of what was before it.")]
After = Annotated[float, typer.Option("--after", metavar="SECONDS", help="How much of what came after it.")]


def add_to(parent: typer.Typer) -> None:
    """Add the commands to `parent`."""
    parent.add_typer(app, name="blackbox")


@app.command("replay")
def replay(
    place: Place,
    around: Around = "",
    before: Before = BEFORE_S,
    after: After = AFTER_S,
    states: Annotated[bool, typer.Option("--states", help="Show what each step changed in the state.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Run the same core over a black box and show each decision.

    Exit code 1: this core decides otherwise than the agent did.
    """
    totals = Totals()
    found = list(moments(_part(place, around, before, after), totals))
    if as_json:
        plain = dataclasses.asdict(totals) | {"moments": [dataclasses.asdict(one) for one in found]}
        typer.echo(json.dumps(plain, indent=2, default=sorted))
    else:
        for one in found:
            typer.echo(_line(one))
            for name, (old, new) in one.changed.items() if states or one.differs else ():
                typer.echo(f"              {name}: {old} -> {new}")
        typer.echo(_summary(totals))
    if totals.differences:
        raise typer.Exit(1)


@app.command("cut")
def cut_command(
    place: Place,
    around: Annotated[str, typer.Option("--around", metavar="HH:MM:SS", help="The time of day on the robot.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="The file to write.")],
    before: Before = BEFORE_S,
    after: After = AFTER_S,
) -> None:
    """Write the part around a time of day to a file that is small enough to send."""
    text = "".join(f"{line}\n" for line in _part(place, around, before, after))
    out.write_text(text, encoding="ascii")
    typer.echo(f"{out}: {len(text) / 1000:.0f} kB. It holds addresses, names and settings of the robot, and no keys.")


@app.command("to-test")
def to_test(
    place: Place,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="The test module to write.")],
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="What the test is about, as an identifier.")],
    around: Around = "",
    before: Before = BEFORE_S,
    after: After = AFTER_S,
    wrong: Annotated[
        str,
        typer.Option("--wrong", metavar="HH:MM:SS.mmm", help="When a decision was wrong; replay shows the times."),
    ] = "",
) -> None:
    """Write a test that fails as the robot did, and the box beside it.

    Where a rule was broken the test fails while one is; with --wrong while the core decides the same then; else it
    expects the decisions that were written.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(f"--name {name}: write an identifier of small letters, for example leaves_too_late")
    title = f"{name.replace('_', ' ').capitalize()}: {place.name}{f' around {around}' if around else ''}."
    try:
        made = story.made(name, title, _part(place, around, before, after), wrong)
    except LookupError as error:
        raise InputError(f"--wrong {wrong}: nothing was decided then; `blackbox replay` shows the times") from error
    out.write_text(made.text, encoding="utf-8")
    box = out.with_suffix(".box")
    box.write_text("".join(f"{line}\n" for line in made.lines), encoding="ascii")
    typer.echo(f"{out}, {box}: {WILL[made.asks]}")


WILL = {
    Asks.NO_BROKEN_RULE: "the test fails while a step breaks a rule of its machine.",
    Asks.NOT_AGAIN: "the test fails while the core decides this again.",
    Asks.AS_EXPECTED: "the test expects what was decided; change EXPECTED where that was wrong.",
}


def _part(place: Path, around: str, before_s: float, after_s: float) -> list[str]:
    lines = ring.lines(place)
    if not around:
        return lines
    at_s = ring.moment(around, ring.last_wall_s(lines))
    part = list(cut(lines, at_s - before_s, at_s + after_s))
    if ring.last_wall_s(part) < at_s - before_s:
        raise InputError(f"--around {around}: the box has nothing of that time; its newest step is of "
                         f"{ring.clock(ring.last_wall_s(lines))}")  # fmt: skip
    return part


def _line(one: DecidedMoment) -> str:
    mark = "" if one.differs is None else f"   DIFFERS from what was written: {one.differs}"
    return f"{ring.clock(one.wall_s)}  {one.machine:9}  {one.event:14} {one.name:12} {one.decision}{mark}"


def _summary(totals: Totals) -> str:
    words = [f"{totals.steps} steps of {len(totals.processes)} processes, {totals.decisions} decisions"]
    words.append(f"{totals.differences} differ from what was written" if totals.differences else "all as written")
    if totals.rules_broken:
        words.append(f"{totals.rules_broken} broke a rule of their machine")
    if totals.gaps:
        words.append(f"{totals.gaps} gaps ({totals.left_out} steps left out by the agent)")
    if totals.other_cores:
        cores: Sequence[str] = sorted(totals.other_cores)
        words.append(f"written by another core ({', '.join(cores)}; this one is {ring.digest_of_core()})")
    return "; ".join(words)
