"""Hot replicas on both sides: switches by hand, then sudden cuts; what the consumer misses of each."""

from __future__ import annotations

import random
from typing import Final

from robot_offload_lab.bench.analysis import hot
from robot_offload_lab.bench.analysis.cuts import Cut, CutAccount
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem
from robot_offload_lab.wire.options import LinkOptions

CASE: Final = BenchCase(
    "hot", LinkOptions(delay="5ms"), tolerance_ms=30, standby="Hot", cloud_standby="Hot",
    switching=(("holdDown", {"initial": "200ms", "max": "400ms", "flapWindow": "500ms"}),),
)  # fmt: skip
"""The cloud comes back soon, so that many cuts fit into a run; what a cut costs does not depend on that."""
LEARN_S: Final = 4.0
"""Time in which a hundred messages of the cloud are received; before, no message is taken for lost."""
CUT_S: Final = (0.4, 0.6)
"""Longer than the two loss timeouts within which a takeover by silence is judged."""
STAY_S: Final = (0.3, 0.6)
REST_S: Final = (0.4, 0.8)


def run(order: Order) -> GroupResult:
    """Switch there and back, then cut the link again and again, each time in a stay of the cloud."""
    chance = random.Random(order.seed)
    with MeasuredSystem(CASE, order.watching(CASE.name)) as world:
        world.rest(LEARN_S)
        for _ in range(order.amounts.hot_switches):
            world.rest(chance.uniform(*REST_S))
            world.ask("robot" if world.site == "cloud" else "cloud")
        cuts = [_cut(world, number, chance) for number in range(1, order.amounts.hot_cuts + 1)]
        evidence = world.finish()
        switching = world.system.spec.switching
    loop_s = (switching.loss_timeout_ms + switching.latency.allowed_loop_ms) / 1e3
    account = CutAccount(
        tuple(cuts), evidence.recording, evidence.robot, evidence.lease, loop_s, switching.lease_ms / 1e3
    )
    return hot.outcome(CASE, order.priority, account)


def _cut(world: MeasuredSystem, number: int, chance: random.Random) -> Cut:
    """Cut the link in a stay of the cloud, restore it, and wait until the cloud is in charge again."""
    world.until(lambda: world.site == "cloud", "the cloud is in charge before a cut")
    world.rest(chance.uniform(*STAY_S))
    length_s = chance.uniform(*CUT_S)
    _, cut_s = world.cut("both")
    world.rest(length_s)
    healed_s, _ = world.cut(None)
    world.until(lambda: world.site == "cloud" and _since(world) > healed_s, "the cloud is in charge again after a cut")
    return Cut(number, "both", length_s, cut_s, healed_s)


def _since(world: MeasuredSystem) -> float:
    return world.placed.decided_s if world.placed is not None else 0.0
