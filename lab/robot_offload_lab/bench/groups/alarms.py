"""A bad but sufficient link for a long time, with a busy data session: nobody may cry wolf."""

from __future__ import annotations

import dataclasses
from typing import Final

from robot_offload_lab.bench.analysis import alarms
from robot_offload_lab.bench.analysis.alarms import QuietStretch
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.resource import BenchCase, Sensor
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

CASE: Final = BenchCase(
    "alarms",
    LinkOptions(delay="40ms", jitter="5ms", loss="3%"),
    tolerance_ms=100,
    sensors=(*(Sensor(f"input_{number}", (200,), 1000) for number in range(3)), Sensor("scan", (10240,), 0)),
    switching=(("lease", "300ms"), ("maxCommandAge", "200ms")),
    output=(("deadline", "400ms"), ("qos", {"reliability": "BestEffort"})),
)
"""The tolerance allows a loop of 130 ms; the link has 80 ± 7. Lease and command age follow from it, the other limits
from what retransmissions cost. The scan is more than the wheel's QUIC carries here, which takes losses for congestion:
it keeps the session as busy as it can be, and is not required, for its age would be a true alarm."""
STEP_S: Final = 1.0


def steps(amounts: Amounts) -> float:
    """For the progress bar."""
    return amounts.stretches * amounts.minutes * 60 / STEP_S


def run(order: Order) -> GroupResult:
    """Watches, each stretch with fresh agents and other chances of the link."""
    watches = []
    for number in range(order.amounts.stretches):
        setting = dataclasses.replace(order.setting(f"{CASE.name}-{number + 1}"), seed=order.seed + number)
        with MeasuredSystem(CASE, setting) as world:
            start_s = steady_s()
            end_s = start_s + order.amounts.minutes * 60
            while steady_s() < end_s:
                world.rest(min(STEP_S, end_s - steady_s()))
                order.advance(1)
            end_s = steady_s()
            evidence = world.finish()
        watches.append(QuietStretch(start_s, end_s, evidence.robot))
    return alarms.outcome(CASE, order.priority, watches)
