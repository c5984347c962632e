"""`make simulate`: the protocol in virtual time, with faults, until an invariant breaks or the time is over."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from robot_offload_sim import campaign
from robot_offload_sim.campaign import Total
from robot_offload_sim.chunk import CHUNK_S
from robot_offload_sim.mutants.mutant_list import EQUIVALENT, MUTANTS

EPILOG = (
    "The real switching core, both sides, runs against a modelled link, modelled processes and nodes; the invariants "
    "of docs/explanation/simulation.md are checked after every event. Exit code 1 on a violation, with a command that "
    "replays it."
)
app = typer.Typer(add_completion=False)


def list_mutants(wanted: bool) -> None:
    """Print each planted fault with its story, and each edit that changes nothing by itself; then end."""
    if not wanted:
        return
    rows = [f"{name}: {mutant.meaning} (found by {mutant.story})" for name, mutant in MUTANTS.items()]
    rows += [f"{name}: {edit.meaning} (changes nothing: {edit.why})" for name, edit in EQUIVALENT.items()]
    sys.stdout.write("\n".join([*rows, ""]))
    raise typer.Exit


@app.command(epilog=EPILOG)
def simulate(
    hours: Annotated[float, typer.Option(min=0.001, help="Simulated hours.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same run.")] = 1,
    chunk: Annotated[int, typer.Option(min=-1, help=f"Only this stretch of {CHUNK_S:g} s; -1: all.")] = -1,
    mutant: Annotated[str, typer.Option(help="Plant a fault by its name, for example S12.")] = "",
    _mutants: Annotated[
        bool, typer.Option("--mutants", callback=list_mutants, is_eager=True, help="List the faults, and end.")
    ] = False,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    commit: Annotated[
        str, typer.Option(help="Commit that the run is expected to be of; another one is warned about.")
    ] = "",
    goals: Annotated[bool, typer.Option("--goals", help="Goals, calls, relays and state in every stretch.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Figures as JSON on standard output.")] = False,
) -> None:
    """Run the switching protocol in virtual time and check its invariants after every event."""
    if mutant and mutant not in MUTANTS:
        sys.stderr.write(f"--mutant {mutant}: no such mutant; there are {', '.join(MUTANTS)}\n")
        raise typer.Exit(2)
    if commit and not commit.startswith(present := present_commit()):
        sys.stderr.write(
            f"--commit {commit}: this is {present or 'no checkout'}; the same seed lives another story here\n"
        )
    indices = range(campaign.chunks_for(hours)) if chunk < 0 else range(chunk, chunk + 1)
    total = Total()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("simulated minutes", total=len(indices))
        for index, outcome in campaign.run(seed, indices, 1 if chunk >= 0 else workers, mutant or None, goals=goals):
            total.add(index, outcome)
            progress.advance(task)
            if outcome.violation:  # a long run reports it at once
                replay = replay_command(seed, index, mutant, goals=goals)
                progress.console.print(f"VIOLATION {outcome.violation}. Replay: {replay}", markup=False, soft_wrap=True)
    for broken in sorted(total.broken, key=lambda b: b.index)[:3]:
        replay = replay_command(seed, broken.index, mutant, goals=goals)
        sys.stderr.write("\n".join([*broken.story, f"VIOLATION {broken.text}", f"Replay: {replay}", ""]))
    sys.stdout.write((json.dumps(figures(total)) if as_json else closing_line(total)) + "\n")
    raise typer.Exit(1 if total.broken else 0)


def replay_command(seed: int, index: int, mutant: str = "", *, goals: bool = False) -> str:
    """Return the command that repeats one stretch; on another commit the seed gives another course of events."""
    planted = (f" --mutant {mutant}" if mutant else "") + (" --goals" if goals else "")
    commit = present_commit()
    named = f" --commit {commit}" if commit else ""
    return f'make simulate ARGS="--seed {seed} --chunk {index}{planted}{named}"'


def present_commit() -> str:
    """Return the short name of this checkout's commit; "" if there is none."""
    asked = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=10", "HEAD"]
    try:
        done = subprocess.run(asked, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


def figures(total: Total) -> dict[str, Any]:
    """Return the figures of a campaign."""
    hours = total.simulated_s / 3600
    return {
        "hours": round(hours, 3),
        "faults": total.faults,
        "faults_per_hour": round(total.faults / hours) if hours else 0,
        "commanded_changeovers": total.commanded,
        "sudden_changeovers": total.sudden,
        "events": total.events,
        "pairs_covered_share": round(total.covered_share, 4),
        "pairs_missing": [list(pair) for pair in total.missing],
        "hours_with_goals": round(total.goals_s / 3600, 3),
        "hours_with_goals_and_state": round(total.state_s / 3600, 3),
        "steps_replayed": total.replayed,
        "stretches_by_world": dict(sorted(total.worlds.items())),
        "violations": [{"chunk": b.index, "text": b.text} for b in total.broken],
    }


def closing_line(total: Total) -> str:
    """Return the figures in one line."""
    values = figures(total)
    return (
        f"{values['hours']:.2f} h simulated, {values['faults']} faults ({values['faults_per_hour']} an hour), "
        f"{total.commanded + total.sudden} changeovers ({total.commanded} commanded, {total.sudden} sudden), "
        f"{total.covered_share:.1%} of state x event pairs covered, {len(total.broken)} violations"
    )
