"""Processor time and memory of the robot's agent in its steady state."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robot_offload_lab.bench.analysis import resources
from robot_offload_lab.bench.analysis.resources import Usage
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.resource import BenchCase, Sensor
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

CASE: Final = BenchCase(
    "resources",
    LinkOptions(delay="5ms"),
    tolerance_ms=60,
    cloud_rate_hz=20.0,
    sensors=tuple(Sensor(f"input_{number}", (1024,)) for number in range(3)),
)
SETTLE_S: Final = 5.0
STEP_S: Final = 1.0
TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


def steps(amounts: Amounts) -> float:
    """For the progress bar."""
    return amounts.resources_s / STEP_S


def run(order: Order) -> GroupResult:
    """Reads /proc before and after."""
    with MeasuredSystem(CASE, order.setting(CASE.name)) as world:
        world.rest(SETTLE_S)
        pids = world.robot_agent()
        before, start_s = usages(pids), steady_s()
        for _ in range(round(order.amounts.resources_s / STEP_S)):
            world.rest(STEP_S)
            order.advance(1)
        after, seconds = usages(pids), steady_s() - start_s
        world.finish()
    return resources.outcome(CASE, order.priority, before, after, seconds)


def usages(pids: Sequence[int]) -> tuple[Usage, ...]:
    """Returns what each process has used so far, and holds now."""
    return tuple(_usage(Path(f"/proc/{pid}")) for pid in pids)


def _usage(process: Path) -> Usage:
    texts = ((process / name).read_text() for name in ("comm", "stat", "smaps_rollup", "smaps"))
    return resources.usage(*texts, ticks_per_s=TICKS_PER_S)
