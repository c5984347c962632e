"""Runs groups of figures one after the other, and keeps the results of each as soon as they exist.

A group that fails or times out is reported; the others keep their results. Results stay in the folder, so that an
interrupted run can be continued.
"""

from __future__ import annotations

import csv
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

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.bench import machine, rows
from robot_offload_lab.bench.groups import (
    commanded,
    cuts,
    detect,
    experiment,
    handover,
    hot,
    keeping,
    lifecycle,
    resources,
    silence,
)
from robot_offload_lab.bench.plan import Form, Order
from robot_offload_lab.bench.results import PRIORITIES, GroupResult, Priority, Sample
from robot_offload_lab.bench.rows import FILE, Circumstances, Row
from robot_offload_lab.bench.table import PRIORITY_WORDS, TITLES, table, with_table
from robot_offload_lab.wire.loop import steady_s

WIDTH: Final = 160
PRIORITY: Final = 1
LIMITS_S: Final[dict[Form, int]] = {"short": 300, "long": 8 * 3600, "own": 8 * 3600}
"""A group that takes longer hangs: every wait within it has a limit of its own."""
PAGE: Final = "benchmarks.md"


class Group(StrEnum):
    """The groups of figures, each measured in worlds of its own."""

    EXPERIMENT = "experiment"
    LIFECYCLE = "lifecycle"
    COMMANDED = "commanded"
    CUTS = "cuts"
    RESOURCES = "resources"
    DETECT = "detect"
    HANDOVER = "handover"
    MIRRORED = "mirrored"
    KEEPING = "keeping"
    HOT = "hot"
    SILENCE = "silence"


WORK: Final[dict[Group, Callable[[Order], GroupResult]]] = {
    Group.EXPERIMENT: experiment.run,
    Group.LIFECYCLE: lifecycle.run,
    Group.COMMANDED: commanded.run,
    Group.CUTS: cuts.run,
    Group.RESOURCES: resources.run,
    Group.DETECT: detect.run,
    Group.HANDOVER: handover.run,
    Group.MIRRORED: handover.run_mirrored,
    Group.KEEPING: keeping.run,
    Group.HOT: hot.run,
    Group.SILENCE: silence.run,
}


class TooLongError(RobotOffloadError):
    """A group did not end in time."""


@dataclass(frozen=True)
class BenchSession:
    """One run of the command.

    Attributes:
        console: for tables.
        folder: where results go.
        docs: folder of the published figures and of the page; None to publish nothing.
    """

    console: Console
    folder: Path
    docs: Path | None = None

    def run(self, wanted: Sequence[Group], priorities: Sequence[Priority], order: Order, *, resume: bool) -> list[str]:
        """Measure; return a line for every group that could not be measured.

        Args:
            wanted: groups, in their order.
            priorities: each group runs with each of them.
            order: what and how; the priority is filled in here.
            resume: leaves out what was measured today in the same form on this machine.

        Raises:
            InputError: the folder, or the one of the docs, has other files of these names.
        """
        # Hundreds of processes are started: the second of a kind is to reuse what the first has compiled.
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        for folder in filter(None, (self.folder, self.docs)):  # refused before hours are spent
            rows.read(folder / FILE)
        done = {_measured(row) for row in self.known()} if resume and order.amounts.form != "own" else set()
        jobs = [(priority, group) for priority in priorities for group in wanted]
        failed = []
        for number, (priority, group) in enumerate(jobs, start=1):
            title = f"{number}/{len(jobs)} {TITLES[group]}, {PRIORITY_WORDS[priority]}"
            under = _circumstances(order.amounts.form, "")
            if (group.value, priority, under.form, under.date, under.machine) in done:
                self._print(f"{title}: measured already")
                continue
            problem = self._measure(title, group, replace(order, priority=priority))
            if problem:
                failed.append(f"{TITLES[group]}, {PRIORITY_WORDS[priority]}: {problem}")
        return failed

    def known(self) -> list[Row]:
        """Return the results in the folder.

        Raises:
            InputError: the folder has other files of these names.
        """
        return rows.read(self.folder / FILE)

    def show(self) -> None:
        """Print the tables; publish what there is, if that is wanted."""
        found = self.known()
        for priority in PRIORITIES:
            if any(row["priority"] == priority for row in found):
                self.console.print(table(found, priority))
        self._print(f"Results and raw samples: {self.folder}")
        if self.docs is not None:
            published = rows.merged(rows.read(self.docs / FILE), found)
            rows.write(self.docs / FILE, published)
            page = self.docs / PAGE
            text = page.read_text(encoding="utf-8") if page.exists() else "# Benchmarks\n\n"
            page.write_text(with_table(text, published), encoding="utf-8")
            self._print(f"Page: {page}")

    def _measure(self, title: str, group: Group, order: Order) -> str:
        """Run one group and keep its results; return why that was not possible."""
        load, began_s = machine.load(), steady_s()
        self._print(f"{title} ...")
        try:
            with _limited(LIMITS_S[order.amounts.form]), _punctual():
                outcome = WORK[group](order)
        except RobotOffloadError as error:
            return self._report(error.lines)
        except Exception:  # unattended: a fault of one group must not lose the others
            return self._report(traceback.format_exc().splitlines())
        under = _circumstances(order.amounts.form, f"{load:.1f} before, {machine.load():.1f} after")
        rows.write(self.folder / FILE, rows.merged(self.known(), rows.rows(outcome, under)))
        _write_samples(self.folder / f"{outcome.group}-{outcome.priority}.csv", outcome.samples)
        self._print(f"{title}: {steady_s() - began_s:.0f} s")
        return ""

    def _report(self, lines: Sequence[str]) -> str:
        for line in lines:
            self.console.print(line, style="red", highlight=False, markup=False, soft_wrap=True)
        return lines[-1] if lines[0].startswith("Traceback") else lines[0]

    def _print(self, line: str) -> None:
        self.console.print(line, highlight=False)


def _circumstances(form: Form, load: str) -> Circumstances:
    return Circumstances(form, machine.today(), machine.commit(), machine.words(machine.describe()), load)


def _measured(row: Row) -> tuple[str, ...]:
    return row["group"], row["priority"], row["form"], row["date"], row["machine"]


def _write_samples(path: Path, samples: Sequence[Sample]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        if samples:
            writer = csv.DictWriter(file, list(samples[0]))
            writer.writeheader()
            writer.writerows(samples)


@contextmanager
def _punctual() -> Iterator[None]:
    """Give this process real-time priority, below everything measured: it records when the link was cut.

    Processes that it starts begin as normal ones; those that need a priority get their own.
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
    """End a block that takes longer by raising an exception in it."""

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError(f"not ended within {seconds} s; look into the logs under runs/, then run it again")

    former = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, former)
