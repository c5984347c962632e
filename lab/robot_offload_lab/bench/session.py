"""Runs groups of figures one after the other, and keeps what each gave as soon as it is there.

A group that fails or times out is reported; the others keep their results. What was measured stays in the folder,
so that an interrupted run can go on.
"""

from __future__ import annotations

import os
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from types import FrameType
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.bench import machine
from robot_offload_lab.bench.groups import (
    alarms,
    collector,
    commanded,
    cuts,
    detect,
    experiment,
    handover,
    hot,
    keeping,
    latency,
    lifecycle,
    resources,
    silence,
)
from robot_offload_lab.bench.plan import FORMS, Amounts, Form, Order
from robot_offload_lab.bench.results import PRIORITIES, GroupResult, Priority
from robot_offload_lab.bench.store import Kept, Store
from robot_offload_lab.bench.table import PRIORITY_WORDS, TITLES, table

WIDTH: Final = 160
PRIORITY: Final = 1
LIMITS_S: Final[dict[Form, int]] = {"short": 300, "long": 8 * 3600}
"""A group that takes longer has stopped: no wait within it is without an end of its own. With more steps than the form
has it may take as much longer."""


class Group(StrEnum):
    """The groups of figures, each measured in worlds of its own."""

    EXPERIMENT = "experiment"
    LIFECYCLE = "lifecycle"
    COLLECTOR = "collector"
    COMMANDED = "commanded"
    CUTS = "cuts"
    ALARMS = "alarms"
    LATENCY = "latency"
    RESOURCES = "resources"
    DETECT = "detect"
    HANDOVER = "handover"
    LOADED = "loaded"
    MIRRORED = "mirrored"
    KEEPING = "keeping"
    HOT = "hot"
    SILENCE = "silence"


@dataclass(frozen=True)
class Work:
    """How a group is run, and how many steps of the progress bar that is."""

    run: Callable[[Order], GroupResult]
    steps: Callable[[Amounts], float]


WORK: Final = {
    Group.EXPERIMENT: Work(experiment.run, experiment.steps),
    Group.LIFECYCLE: Work(lifecycle.run, lifecycle.steps),
    Group.COLLECTOR: Work(collector.run, collector.steps),
    Group.COMMANDED: Work(commanded.run, commanded.steps),
    Group.CUTS: Work(cuts.run, cuts.steps),
    Group.ALARMS: Work(alarms.run, alarms.steps),
    Group.LATENCY: Work(latency.run, latency.steps),
    Group.RESOURCES: Work(resources.run, resources.steps),
    Group.DETECT: Work(detect.run, detect.steps),
    Group.HANDOVER: Work(handover.run, handover.steps),
    Group.LOADED: Work(handover.run_loaded, handover.steps),
    Group.MIRRORED: Work(handover.run_mirrored, handover.steps_mirrored),
    Group.KEEPING: Work(keeping.run, keeping.steps),
    Group.HOT: Work(hot.run, hot.steps),
    Group.SILENCE: Work(silence.run, silence.steps),
}
HANDOVER: Final = (Group.HANDOVER, Group.LOADED, Group.MIRRORED, Group.KEEPING)
HOT: Final = (Group.HOT, Group.SILENCE)
SWITCH: Final = (Group.COMMANDED, Group.CUTS, Group.ALARMS, Group.LATENCY, Group.RESOURCES)


class TooLongError(RobotOffloadError):
    """A group has not ended in time."""


@dataclass(frozen=True)
class BenchSession:
    """One run of a command.

    Attributes:
        console: for tables and bars.
        store: where results go.
        docs: folder of the page; None for no page.
    """

    console: Console
    store: Store
    docs: Path | None = None

    def run(self, wanted: Sequence[Group], priorities: Sequence[Priority], order: Order, *, resume: bool) -> list[str]:
        """Measures; returns a line for every group that could not be measured.

        Args:
            wanted: groups, in their order.
            priorities: each runs with each of them.
            order: what and how; priority and advance are filled in here.
            resume: leaves out what was measured today in the same form on this machine.

        Raises:
            InputError: the folder holds something else.
        """
        # Hundreds of processes are started: the second of a kind shall find compiled what the first has compiled.
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        before = self.store.all()  # a folder of something else is refused before hours are spent
        jobs = [(priority, group) for priority in priorities for group in wanted]
        failed = []
        for number, (priority, group) in enumerate(jobs, start=1):
            title = f"{number}/{len(jobs)} {TITLES[group]}, {PRIORITY_WORDS[priority]}"
            if resume and any(_is_done(kept, group, priority, order.amounts) for kept in before):
                self.console.print(f"{title}: measured already", highlight=False)
                continue
            problem = self._measure(title, group, replace(order, priority=priority))
            if problem:
                failed.append(f"{TITLES[group]}, {PRIORITY_WORDS[priority]}: {problem}")
        return failed

    def show(self) -> None:
        """Prints the tables, writes the pictures, and the page if one is wanted."""
        kept = self.store.all()
        outcomes = [one.outcome for one in kept]
        for priority in PRIORITIES:
            if any(outcome.priority == priority for outcome in outcomes):
                self.console.print(table(outcomes, priority))
        self.console.print(f"Results and raw samples: {self.store.folder}", highlight=False)
        try:
            from robot_offload_lab.bench import page, pictures  # noqa: PLC0415 - matplotlib takes a second to import
        except ImportError as error:
            self.console.print(f"No pictures and no page: {error}; install matplotlib", highlight=False)
            return
        for name, picture in pictures.draw(outcomes, page.notes(kept)).items():
            (self.store.folder / f"{name}.png").write_bytes(picture.png)
        if self.docs is not None:
            self.console.print(f"Page: {page.write(kept, self.docs)}", highlight=False)

    def _measure(self, title: str, group: Group, order: Order) -> str:
        """Runs one group and keeps what came out; returns why that was not possible."""
        load = machine.load()
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        work = WORK[group]
        try:
            # Refreshed by hand: a thread of its own would endanger the starting of processes.
            with Progress(*columns, console=self.console, auto_refresh=False) as progress:
                task = progress.add_task(title, total=work.steps(order.amounts))
                progress.refresh()

                def advance(steps: float) -> None:
                    progress.advance(task, steps)
                    progress.refresh()

                with _limited(_limit_s(work, order.amounts)), _punctual():
                    outcome = work.run(replace(order, advance=advance))
                progress.update(task, completed=work.steps(order.amounts))
                progress.refresh()
        except RobotOffloadError as error:
            return self._tell(error.lines)
        except Exception:  # unattended: the other groups shall not be lost by a fault of one
            return self._tell(traceback.format_exc().splitlines())
        self.store.put(Kept(outcome, machine.today(), machine.describe(), (load, machine.load()), order.amounts))
        return ""

    def _tell(self, lines: Sequence[str]) -> str:
        for line in lines:
            self.console.print(line, style="red", highlight=False, markup=False, soft_wrap=True)
        return lines[-1] if lines[0].startswith("Traceback") else lines[0]


def _is_done(kept: Kept, group: Group, priority: Priority, amounts: Amounts) -> bool:
    known = (kept.outcome.group, kept.outcome.priority, kept.amounts, kept.date, kept.machine)
    return known == (group, priority, amounts, machine.today(), machine.describe())


def _limit_s(work: Work, amounts: Amounts) -> int:
    usual = work.steps(FORMS[amounts.form])
    return round(LIMITS_S[amounts.form] * max(1.0, work.steps(amounts) / usual if usual else 1.0))


@contextmanager
def _punctual() -> Iterator[None]:
    """Real-time priority for this process, below everything measured: it says when the link was cut.

    What it starts begins as a normal process, and gets a priority of its own where it shall have one.
    """
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    try:
        yield
    finally:
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextmanager
def _limited(seconds: int) -> Iterator[None]:
    """Ends what takes longer, by an exception in it."""

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError(f"not ended within {seconds} s; look into the logs under runs/, then run it again")

    former = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, former)
