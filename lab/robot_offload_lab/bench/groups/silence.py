"""A bad but sufficient link for a long time, Hot replicas on both sides: who takes over although the cloud speaks?"""

from __future__ import annotations

import dataclasses
from typing import Final

from robot_offload_lab.bench.analysis import silence
from robot_offload_lab.bench.analysis.alarms import QuietStretch
from robot_offload_lab.bench.groups.hot import LEARN_S
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.resource import BenchCase, Sensor
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

STEP_S: Final = 1.0
BAD: Final = BenchCase(
    "bad",
    LinkOptions(delay="40ms", jitter="5ms", loss="3%"),
    tolerance_ms=100,
    switching=(("lease", "300ms"), ("maxCommandAge", "200ms")),
    output=(("deadline", "400ms"), ("qos", {"reliability": "BestEffort"})),
)
"""The tolerance allows a loop of 130 ms; the link has 80 ± 7. Lease and command age follow from it, the other limits
from what retransmissions cost."""
RELIABLE: Final[BenchCase] = dataclasses.replace(
    BAD,
    name="reliable",
    standby="Hot",
    cloud_standby="Hot",
    sensors=(Sensor("odom", (200,), 1000),),
    output=(("deadline", "400ms"),),
)
"""The command is reliable, as a publisher's default is: what is lost comes late."""
BEST_EFFORT: Final = dataclasses.replace(RELIABLE, name="best-effort", output=BAD.output)
"""Lost messages never come, and look like silence of their sender."""
CASES: Final = (RELIABLE, BEST_EFFORT)


def run(order: Order) -> GroupResult:
    """Watch one long stay of each case."""
    watched = [(case, _watch(case, order)) for case in CASES if order.wants(case.name)]
    return silence.outcome(order.priority, watched)


def _watch(case: BenchCase, order: Order) -> QuietStretch:
    with MeasuredSystem(case, order.setting(f"silence-{case.name}")) as world:
        world.rest(LEARN_S)
        start_s = steady_s()
        end_s = start_s + order.amounts.hot_minutes * 60
        while steady_s() < end_s:
            world.rest(min(STEP_S, end_s - steady_s()))
        end_s = steady_s()
        evidence = world.finish()
    return QuietStretch(start_s, end_s, evidence.robot)
