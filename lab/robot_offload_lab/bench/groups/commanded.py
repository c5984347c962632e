"""Switches by hand, through the services that a person or another decision maker uses."""

from __future__ import annotations

import random
from typing import Final

from robot_offload_lab.bench.analysis import commanded
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.wire.options import LinkOptions

CASE: Final = BenchCase("commanded", LinkOptions(delay="5ms"), tolerance_ms=30)
REST_S: Final = (0.4, 0.8)
"""Between two switches, at random, so that they meet every phase of the timers."""


def run(order: Order) -> GroupResult:
    """Switch there and back."""
    chance = random.Random(order.seed)
    with MeasuredSystem(CASE, order.setting(CASE.name)) as world:
        for _ in range(order.amounts.switches):
            world.rest(chance.uniform(*REST_S))
            world.ask("robot" if world.site == "cloud" else "cloud")
        world.rest(REST_S[1])
        evidence = world.finish()
    return commanded.outcome(CASE, order.priority, evidence.recording, evidence.robot, evidence.cloud)
