"""Processor time and memory of both agents in their steady state, beside those of another commit if one is named."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from robot_offload.api.v1alpha1.names import Side
from robot_offload.errors import InputError
from robot_offload_lab.bench.analysis import resources
from robot_offload_lab.bench.analysis.resources import Usage, Weighed
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.resource import BenchCase, Sensor
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem, Setting
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

CASE: Final = BenchCase(
    "resources",
    LinkOptions(delay="5ms"),
    tolerance_ms=60,
    cloud_rate_hz=20.0,
    sensors=tuple(Sensor(f"input_{number}", (1024,)) for number in range(3)),
)
SINGLE: Final = replace(CASE, name="resources-single", sensors=CASE.sensors[:1])
"""One topic alone: the difference is what each further one costs."""
SIDES: Final[tuple[Side, Side]] = ("robot", "cloud")
HERE: Final = Path(__file__).parent
SETTLE_S: Final = 5.0
STEP_S: Final = 1.0
TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


def run(order: Order) -> GroupResult:
    """Read /proc before and after."""
    whole = observe(CASE, order.setting(CASE.name), order)
    single = observe(SINGLE, order.setting(SINGLE.name), order)
    if not order.against:
        return resources.outcome(order.priority, whole, single)
    with checked_out(order.against) as tree:
        earlier = observe(CASE, replace(order.setting(f"{CASE.name}-against"), agents=tree), order)
    return resources.outcome(order.priority, whole, single, earlier, order.against)


def observe(case: BenchCase, setting: Setting, order: Order) -> Weighed:
    """Run one system; return what its agents cost."""
    with MeasuredSystem(case, replace(setting, beats=False)) as world:
        world.rest(SETTLE_S)
        sides = {side: world.agent(side) for side in SIDES}
        before, start_s = {side: usages(pids) for side, pids in sides.items()}, steady_s()
        for _ in range(round(order.amounts.resources_s / STEP_S)):
            world.rest(STEP_S)
        after, seconds = {side: usages(pids) for side, pids in sides.items()}, steady_s() - start_s
        world.finish()
    robot, cloud = (resources.costs(before[side], after[side], seconds) for side in SIDES)
    return Weighed(case, seconds, robot, cloud, resources.alone_mb(after["robot"]))


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """Provide the tree of a commit of this repository in a folder of its own.

    Raises:
        InputError: there is no such commit, or this is not a clone.
    """
    with tempfile.TemporaryDirectory(prefix="ro-tree-") as folder:
        tree = Path(folder) / "tree"
        _git("worktree", "add", "--detach", str(tree), commit)
        try:
            yield tree
        finally:
            _git("worktree", "remove", "--force", str(tree))


def _git(*words: str) -> None:
    done = subprocess.run(["git", "-C", str(HERE), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"--against: {done.stderr.strip()}; name a commit of this clone")


def usages(pids: Sequence[int]) -> tuple[Usage, ...]:
    """Return what each process has used so far, and holds now."""
    return tuple(_usage(Path(f"/proc/{pid}")) for pid in pids)


def _usage(process: Path) -> Usage:
    texts = ((process / name).read_text() for name in ("comm", "stat", "smaps_rollup", "smaps"))
    return resources.usage(*texts, ticks_per_s=TICKS_PER_S)
