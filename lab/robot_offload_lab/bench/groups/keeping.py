"""Snapshots of several sizes through sudden cuts: how old the robot's are, and how soon its node goes on from them."""

from __future__ import annotations

import dataclasses
import random
from typing import Final

from robot_offload_lab.bench import observed
from robot_offload_lab.bench.analysis import keeping
from robot_offload_lab.bench.analysis.keeping import StateAccount
from robot_offload_lab.bench.groups.hot import CASE as HOT
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.resource import NODE, BenchCase
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem

KIB: Final = 1024
CASES: Final = tuple(
    dataclasses.replace(
        HOT, name=f"state-{name}", standby="Warm", cloud_standby="Warm", state_bytes=size, state_rate_hz=rate_hz
    )
    for name, size, rate_hz in (("1KiB", KIB, 10.0), ("1MiB", KIB * KIB, 10.0), ("16MiB", 16 * KIB * KIB - KIB, 0.2))
)
"""The largest leaves room for the headers of a message of 16 MiB, and comes seldom: it takes seconds to cross."""
CUT_S: Final = 0.6
STAY_S: Final = (0.8, 1.4)
LARGE_CUTS: Final = 3
"""Most cuts with the largest size."""


def run(order: Order) -> GroupResult:
    """Cut the link again and again in stays of the cloud, for each size in a world of its own."""
    wanted = [case for case in CASES if order.wants(case.name)]
    return keeping.outcome(order.priority, [_measure(case, order) for case in wanted])


def _cuts(case: BenchCase, amounts: Amounts) -> int:
    return min(amounts.state_cuts, LARGE_CUTS) if case is CASES[-1] else amounts.state_cuts


def _measure(case: BenchCase, order: Order) -> StateAccount:
    chance = random.Random(order.seed)
    cuts = []
    with MeasuredSystem(case, order.setting(case.name)) as world:
        for _ in range(_cuts(case, order.amounts)):
            world.until(lambda: world.site == "cloud", "the cloud is in charge before a cut")
            world.rest(chance.uniform(*STAY_S) + 2.0 / case.state_rate_hz)
            cuts.append(world.cut("both")[1])
            world.rest(CUT_S)
            world.cut(None)
            world.until(lambda: world.site == "cloud", "the cloud is in charge again after a cut")
        evidence = world.finish()
        kept = observed.read(world.system.source / f"{NODE}.jsonl")
    return StateAccount(case, tuple(cuts), kept, evidence.recording)
