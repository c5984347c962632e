"""Sudden cuts of the link, in both directions and in one, with everything at the product's defaults."""

from __future__ import annotations

import random
from typing import Final

from robot_offload_lab.bench.analysis import cuts
from robot_offload_lab.bench.analysis.cuts import Cut, CutAccount
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import Direction, MeasuredSystem
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

CASE: Final = BenchCase("cuts", LinkOptions(delay="5ms"), tolerance_ms=30)
SHORT_S: Final = 2.0
LONG_S: Final = 10.0
LONGER_S: Final = (0.0, 0.7)
"""Each cut is lengthened by a random time, so that it ends in every phase of the attempts to reconnect."""
STAY_FACTOR: Final = 5.0
"""The cloud then stays in charge this many times as long as its return took: cuts are rare enough for 80 %."""
STAY_MORE_S: Final = (1.0, 1.5)


def order_of_cuts(amounts: Amounts, chance: random.Random) -> list[tuple[Direction, float]]:
    """Return (direction, length in seconds) of every cut, mixed."""
    wanted: tuple[tuple[Direction, float, int], ...] = (
        ("both", SHORT_S, amounts.cuts),
        ("both", LONG_S, amounts.long_cuts),
        ("up", SHORT_S, amounts.one_way),
        ("down", SHORT_S, amounts.one_way),
    )
    found = [(direction, length_s) for direction, length_s, count in wanted for _ in range(count)]
    chance.shuffle(found)
    return found


def run(order: Order) -> GroupResult:
    """Cut the link, restore it, wait until the policy has returned to the cloud, and stay there for a while."""
    chance = random.Random(order.seed)
    done = []
    with MeasuredSystem(CASE, order.watching(CASE.name)) as world:
        world.rest(1.0)
        for number, (direction, length_s) in enumerate(order_of_cuts(order.amounts, chance), start=1):
            world.rest(chance.uniform(*STAY_MORE_S))
            world.until(lambda: world.site == "cloud", "the cloud is in charge before a cut")
            _, cut_s = world.cut(direction)
            world.rest(length_s + chance.uniform(*LONGER_S))
            healed_s, _ = world.cut(None)
            done.append(Cut(number, direction, length_s, cut_s, healed_s))
            world.until(lambda: world.site == "cloud", "the cloud is in charge again after a cut")
            world.rest(STAY_FACTOR * (steady_s() - healed_s))
        evidence = world.finish()
        switching = world.system.spec.switching
    account = CutAccount(
        cuts=tuple(done),
        recording=evidence.recording,
        robot=evidence.robot,
        lease=evidence.lease,
        loop_limit_s=(switching.loss_timeout_ms + switching.latency.allowed_loop_ms) / 1e3,
        lease_s=switching.lease_ms / 1e3,
    )
    return cuts.outcome(CASE, order.priority, account)
