"""`robot-offload simulate`: try a switching policy on a recorded link before a robot does."""

from __future__ import annotations

import dataclasses
import importlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from robot_offload.api.v1alpha1.quantities import parse_duration
from robot_offload.cli.app import example_text
from robot_offload.errors import InputError
from robot_offload.replay import show, study, tune
from robot_offload.replay.costs import Weights
from robot_offload.replay.named import POLICIES, NamedPolicy, find
from robot_offload.replay.study import Case
from robot_offload.traces import load_trace
from robot_offload_core.settings import Settings

EXAMPLES = (
    "robot-offload simulate --trace examples/traces/corridor-wifi.txt --tolerance 20ms",
    "robot-offload simulate --trace link.csv@100ms --compare --out out/simulate",
    "robot-offload simulate --trace link.csv --policy mypolicy:make --json | jq '.recordings[0].policies[0].cost'",
    "robot-offload simulate --trace wifi.txt@20ms --trace phone.txt@100ms --trace site.txt@50ms --tune",
)
Step = Callable[[int], None]
PLAIN_COLUMNS = 120


def add_to(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("simulate", epilog=example_text(EXAMPLES))(simulate)


def _option(name: str, metavar: str, text: str) -> Any:
    """An option with a value; its default stands in the signature."""
    return typer.Option(f"--{name}", metavar=metavar, help=text)


Traces = Annotated[
    list[str] | None,
    _option(
        "trace",
        "FILE[@TOLERANCE]",
        "Recorded round-trip times: one in ms per line, measured back to back, or CSV t_s,rtt_ms with an empty rtt_ms "
        "for a lost request. More than once, each with a tolerance of its own if need be.",
    ),
]
PolicyName = Annotated[
    str, _option("policy", "NAME", f"One of {', '.join(POLICIES)}, or module:function for your own (docs/policies.md).")
]
Tolerance = Annotated[str, _option("tolerance", "TIME", "How much slower the loop through the cloud may be.")]
RobotPeriod = Annotated[str, _option("robot-period", "TIME", "Time between two outputs of the robot's replica.")]
CloudPeriod = Annotated[str, _option("cloud-period", "TIME", "The same for the cloud's replica.")]
LossTimeout = Annotated[str, _option("loss-timeout", "TIME", "Silence that means a lost link (ours, thesis, dwell).")]
WeightsText = Annotated[
    str,
    _option(
        "weights",
        "E/W/S",
        "Price of a second exposed, a second wasted, and a switch: J = E * exposed_s + W * wasted_s + S * switches.",
    ),
]
Compare = Annotated[bool, typer.Option("--compare", help="Replay all policies and print a table.")]
Tune = Annotated[
    bool,
    typer.Option("--tune", help="Search figures of our rule; each trace in turn is left out and reported on."),
]
Out = Annotated[Path | None, _option("out", "DIR", "Folder for results.json and placement.png.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the results as JSON on standard output.")]


def simulate(
    *,
    trace: Traces = None,
    policy: PolicyName = "ours",
    tolerance: Tolerance = "30ms",
    robot_period: RobotPeriod = "50ms",
    cloud_period: CloudPeriod = "20ms",
    loss_timeout: LossTimeout = "90ms",
    weights: WeightsText = "10/1/0.5",
    compare: Compare = False,
    tune_figures: Tune = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Try a switching policy on a recorded link: where it would have acted, and what that would have cost.

    The link is good enough at a moment if a heartbeat sent then is back within robotPeriod + tolerance - cloudPeriod.
    A policy is exposed while it acts in the cloud and the link is not good enough, and wastes time while it acts on the
    robot and the link is. The optimum is the least cost of all, found with the whole recording known; ratio is
    J / optimum. Ends with 0, or with 2 when the input is wrong.
    """
    times_ms = {
        "--tolerance": tolerance,
        "--robot-period": robot_period,
        "--cloud-period": cloud_period,
        "--loss-timeout": loss_timeout,
    }
    if tune_figures:
        _check_tuning(trace or [], compare)
    cases = _cases(trace or [], {option: _ms(option, text) for option, text in times_ms.items()}, _weights(weights))
    if out is not None:
        _writing(out, lambda: out.mkdir(parents=True, exist_ok=True))  # before minutes of work, not after
    console = _console(as_json)
    results = _tuned(cases, console) if tune_figures else _replayed(cases, _chosen(policy, compare), console, out)
    if out is not None:
        _writing(out, lambda: (out / "results.json").write_text(json.dumps(results, indent=2) + "\n"))
        console.print(f"Written: {out}", soft_wrap=True)
    if as_json:
        typer.echo(json.dumps(results, indent=2))


# -- doing ------------------------------------------------------------------------------------------------------------


def _replayed(
    cases: Sequence[Case], policies: Sequence[NamedPolicy], console: Console, out: Path | None
) -> dict[str, Any]:
    total = sum(len(subject.beats.sent_us) for subject in cases) * len(policies)
    with _bar("replaying", total) as step:
        done = [(subject, [study.outcome(each, subject, step) for each in policies]) for subject in cases]
    for subject, outcomes in done:
        console.print(show.heading(subject), soft_wrap=True)
        console.print(show.table(subject, outcomes))
        if len(outcomes) == 1:
            for line in show.strips(subject, outcomes[0]):
                console.print(line, soft_wrap=True)
    if out is not None:
        # Imported only here: drawing takes longer to load than all other commands together.
        picture = importlib.import_module("robot_offload.replay.picture")
        _writing(out, lambda: (out / "placement.png").write_bytes(picture.draw(done)))
    return {"recordings": [study.plain(subject, outcomes) for subject, outcomes in done]}


def _tuned(cases: Sequence[Case], console: Console) -> dict[str, Any]:
    with _bar("searching", tune.steps(cases)) as step:
        reports = tune.leave_one_out(cases, study.outcome, step)
    console.print(show.tuning(reports))
    return {"tuning": [dataclasses.asdict(report) for report in reports]}


@contextmanager
def _bar(words: str, total: int) -> Iterator[Step]:
    """A progress bar on standard error, when that is a terminal."""
    columns = TextColumn(words), BarColumn(), TimeRemainingColumn()
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task(words, total=total)
        yield lambda steps: progress.advance(task, steps)


def _console(as_json: bool) -> Console:
    """For people. The JSON stands alone on standard output; without a terminal a table needs no folding."""
    console = Console(stderr=as_json, highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, PLAIN_COLUMNS)
    return console


def _writing(out: Path, write: Callable[[], object]) -> None:
    try:
        write()
    except OSError as error:
        raise InputError(f"--out: cannot write to {out}: {error.strerror}") from error


# -- reading options --------------------------------------------------------------------------------------------------


def _chosen(name: str, compare: bool) -> list[NamedPolicy]:
    chosen = find(name)
    if not compare:
        return [chosen]
    return list({each.name: each for each in [*POLICIES.values(), chosen]}.values())


def _check_tuning(traces: Sequence[str], compare: bool) -> None:
    if compare:
        raise InputError("--tune, --compare: one of them at a time; --tune tells the best other rule by itself")
    files = {_file_and_tolerance(text, 0)[0].resolve() for text in traces}
    if len(files) < max(2, len(traces)):
        raise InputError("--tune: needs two different traces or more, because it never reports on what it searched")


def _cases(traces: Sequence[str], times_ms: dict[str, int], weights: Weights) -> list[Case]:
    if not traces:
        raise InputError("--trace: name a recording, for example --trace examples/traces/corridor-wifi.txt")
    cases = []
    for text in traces:
        file, tolerance_ms = _file_and_tolerance(text, times_ms["--tolerance"])
        settings = _settings({**times_ms, "--tolerance": tolerance_ms})
        cases.append(study.case(load_trace(file), settings, weights))
    return cases


def _file_and_tolerance(text: str, default_ms: int) -> tuple[Path, int]:
    name, at, tolerance = text.rpartition("@")
    if not at or Path(text).exists():  # a file may have an @ in its name
        return Path(text), default_ms
    return Path(name), _ms(f"--trace {text}", tolerance)


def _settings(times_ms: dict[str, int]) -> Settings:
    settings = Settings(
        loss_timeout_s=times_ms["--loss-timeout"] / 1e3,
        robot_period_s=times_ms["--robot-period"] / 1e3,
        cloud_period_s=times_ms["--cloud-period"] / 1e3,
        tolerance_s=times_ms["--tolerance"] / 1e3,
    )
    if settings.allowed_loop_s <= 0:
        raise InputError("--tolerance: robot period + tolerance - cloud period must be more than 0ms")
    least_ms = round(2 * settings.beat_period_s * 1e3)
    if times_ms["--loss-timeout"] <= least_ms:
        raise InputError(f"--loss-timeout: must be more than two heartbeats ({least_ms}ms), one lost beat is normal")
    return settings


def _ms(option: str, text: str) -> int:
    try:
        return parse_duration(text)
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None


def _weights(text: str) -> Weights:
    try:
        exposed, wasted, switch = (float(part) for part in text.split("/"))
    except ValueError:
        raise InputError(f"--weights: {text!r}: write three numbers, for example 10/1/0.5") from None
    if not all(0 < price < 1e9 for price in (exposed, wasted, switch)):
        raise InputError(f"--weights: {text!r}: every price must be more than 0")
    return Weights(exposed, wasted, switch)
