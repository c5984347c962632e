"""The work of `robot-offload simulate`: reads recordings, replays them, shows and writes what came out."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from robot_offload.errors import InputError
from robot_offload_core.words.settings import Settings
from robot_offload_lab.links.recorded import load_trace
from robot_offload_lab.replay import picture, show, study, tune
from robot_offload_lab.replay.costs import Weights
from robot_offload_lab.replay.named import POLICIES, NamedPolicy, find
from robot_offload_lab.replay.study import StudiedLink

PLAIN_COLUMNS: Final = 160
Step = Callable[[int], None]


@dataclass(frozen=True)
class TraceRequest:
    """A recording to replay, and how.

    Attributes:
        file: the recording.
        settings: settings of the agent.
        adapt: whether the loss timeout follows the recording.
    """

    file: Path
    settings: Settings
    adapt: bool


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line.

    Attributes:
        recordings: to replay, or to search on.
        report_on: to report on after a search; none: each recording in turn is left out of the search.
        policy: name of the policy.
        compare: whether to replay all policies.
        tune: whether to search figures of our rule.
        weights: prices per second exposed, per second wasted, per switch.
        out: folder for results; None for none.
        as_json: the results as JSON on standard output.
    """

    recordings: tuple[TraceRequest, ...]
    report_on: tuple[TraceRequest, ...] = ()
    policy: str = "ours"
    compare: bool = False
    tune: bool = False
    weights: tuple[float, float, float] = (10.0, 1.0, 0.5)
    out: Path | None = None
    as_json: bool = False


def run(request: Request) -> str | None:
    """Carry out the request; return the JSON for standard output, None when none was requested.

    Raises:
        InputError: a recording, a policy or the folder cannot be used.
    """
    if request.tune:
        _check_tuning(request)
    weights, out = Weights(*request.weights), request.out
    cases = [_case(each, weights) for each in request.recordings]
    held_out = [_case(each, weights) for each in request.report_on]
    chosen = _chosen(request.policy, request.compare)
    if out is not None:
        _writing(out, lambda: out.mkdir(parents=True, exist_ok=True))  # before minutes of work, not after
    console = _console(request.as_json)
    results = _tuned(cases, held_out, console) if request.tune else _replayed(cases, chosen, console, out)
    if out is not None:
        _writing(out, lambda: (out / "results.json").write_text(json.dumps(results, indent=2) + "\n"))
        console.print(f"Written: {out}", soft_wrap=True)
    return json.dumps(results, indent=2) if request.as_json else None


def _replayed(
    cases: Sequence[StudiedLink], policies: Sequence[NamedPolicy], console: Console, out: Path | None
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
    if len(done) > 1:
        console.print(show.summary(done))
    if out is not None:
        _writing(out, lambda: (out / "placement.png").write_bytes(picture.draw(done)))
    recordings = [study.plain(subject, outcomes) for subject, outcomes in done]
    results: dict[str, Any] = {"recordings": recordings}
    if len(recordings) == len(policies) == 1:  # the figures at hand, without a path to them
        results |= {name: value for name, value in recordings[0]["policies"][0].items() if name != "changes"}
    return results


def _tuned(cases: Sequence[StudiedLink], held_out: Sequence[StudiedLink], console: Console) -> dict[str, Any]:
    with _bar("searching", tune.steps(cases, held_out)) as step:
        reports = tune.search(cases, held_out, study.outcome, step)
    console.print(show.tuning(reports))
    return {"tuning": [dataclasses.asdict(report) for report in reports]}


@contextmanager
def _bar(words: str, total: int) -> Iterator[Step]:
    """Yield the step of a progress bar on standard error, when that is a terminal."""
    columns = TextColumn(words), BarColumn(), TimeRemainingColumn()
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task(words, total=total)
        yield lambda steps: progress.advance(task, steps)


def _console(as_json: bool) -> Console:
    """Return the console for people; standard output has the JSON alone."""
    console = Console(stderr=as_json, highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, PLAIN_COLUMNS)
    return console


def _writing(out: Path, write: Callable[[], object]) -> None:
    try:
        write()
    except OSError as error:
        raise InputError(f"--out: cannot write to {out}: {error.strerror}") from error


def _chosen(name: str, compare: bool) -> list[NamedPolicy]:
    chosen = find(name)
    if not compare:
        return [chosen]
    return list({each.name: each for each in [*POLICIES.values(), chosen]}.values())


def _case(recording: TraceRequest, weights: Weights) -> StudiedLink:
    return study.case(load_trace(recording.file), recording.settings, weights, adapt=recording.adapt)


def _check_tuning(request: Request) -> None:
    """Refuse to report on a recording that was searched, even under another file name."""
    if request.compare:
        raise InputError("--tune, --compare: one of them at a time; --tune reports the best other rule by itself")
    searched = {_fingerprint(each.file): each.file for each in request.recordings}
    for each in request.report_on:
        same = searched.get(_fingerprint(each.file))
        if same is not None:
            raise InputError(
                f"--report-on {each.file}: that is the recording {same}, which is searched; name another one"
            )
    if len(searched) < (1 if request.report_on else 2) or len(searched) < len(request.recordings):
        raise InputError(
            "--tune: needs two different traces or more (or one and --report-on), because it never reports on what it "
            "searched"
        )


def _fingerprint(file: Path) -> str:
    """Return a text that is equal for equal recordings; an unreadable file is reported when it is loaded."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return str(file.resolve())
