"""Goals and calls of a stock client while the execution moves, and what the relay costs beside the direct path."""

from __future__ import annotations

import dataclasses
import os
import random
import signal
from typing import Final

from robot_offload_lab.bench.analysis import handover
from robot_offload_lab.bench.analysis.handover import HandoverAccount, Moment, Phase
from robot_offload_lab.bench.groups.hot import CASE as HOT
from robot_offload_lab.bench.groups.hot import LEARN_S
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.world import MeasuredSystem, Setting
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

DELAY_MS: Final = 5
CASE: Final = BenchCase("handover", LinkOptions(delay=f"{DELAY_MS}ms"), tolerance_ms=30, serves=True)
MIRRORED: Final = dataclasses.replace(HOT, name="mirrored", serves=True, mirrors=True)
"""Both sides execute each goal; the cloud comes back soon after a cut."""
PRODUCT, DIRECT = "/bench", "/direct"
ALIVE: Final = 3
"""Goals alive at once."""
ORDER: Final = {"commanded": 90, "cut": 150, "killed": 120}
"""Ticks of 20 ms: the goals outlast what happens to them."""
BEFORE_S: Final = (0.3, 0.5)
CUT_S: Final = 1.0
KILLS: Final = 3
WARM: Final = 5


def run(order: Order) -> GroupResult:
    """Measure acceptance and call on each path, then switch, cut and kill with goals alive."""
    return handover.outcome(handover.GROUP, CASE, order.priority, _measure(order, order.serving(CASE.name)))


def run_mirrored(order: Order) -> GroupResult:
    """Cut the link while both sides execute the goals."""
    chance = random.Random(order.seed)
    with MeasuredSystem(MIRRORED, order.serving(MIRRORED.name)) as world:
        world.rest(LEARN_S)
        moments = [_happen(world, "cut", chance) for _ in range(order.amounts.mirror_cuts)]
        world.rest(1.0)  # a second result would come now
        evidence = world.finish()
    account = HandoverAccount((), tuple(moments), evidence.goals, 0.0, 2.0 * DELAY_MS)
    return handover.mirrored(MIRRORED, order.priority, account)


def _measure(order: Order, setting: Setting) -> HandoverAccount:
    chance = random.Random(order.seed)
    with MeasuredSystem(CASE, setting) as world:
        world.rest(2.0)  # discovery of the clients
        phases = [_ask(world, order, DIRECT, "direct")]
        for site in ("cloud", "robot"):
            if world.site != site:
                world.ask(site)
            phases.append(_ask(world, order, PRODUCT, site))
        moments = [_happen(world, "commanded", chance) for _ in range(order.amounts.switches)]
        moments += [_happen(world, "cut", chance) for _ in range(order.amounts.cuts)]
        moments += [_happen(world, "killed", chance) for _ in range(KILLS)]
        world.rest(1.0)  # a second result would come now
        evidence = world.finish()
        loss_ms = world.system.spec.switching.loss_timeout_ms
    return HandoverAccount(tuple(phases), tuple(moments), evidence.goals, loss_ms, 2.0 * DELAY_MS)


def _ask(world: MeasuredSystem, order: Order, prefix: str, name: str) -> Phase:
    count = order.amounts.rounds
    world.have(2 * WARM, {"accept": WARM, "prefix": prefix}, "first goals end")
    world.have(WARM, {"calls": WARM, "prefix": prefix}, "first calls are answered")
    begin_s = steady_s()
    world.have(2 * count, {"accept": count, "prefix": prefix}, "short goals end")
    world.have(count, {"calls": count, "prefix": prefix}, "calls are answered")
    return Phase(name, prefix, begin_s, steady_s())


def _happen(world: MeasuredSystem, kind: str, chance: random.Random) -> Moment:
    """Start goals, let something happen to them, and wait for their results."""
    if kind == "cut":
        world.until(lambda: world.site == "cloud", "the cloud is in charge before a cut")
    begin_s = steady_s()
    command = {"goals": ALIVE, "order": ORDER[kind], "prefix": PRODUCT}
    world.have(ALIVE, command, "goals are accepted")
    known = len(world.answers)
    world.rest(chance.uniform(*BEFORE_S))
    at_s = steady_s()
    if kind == "commanded":
        world.ask("robot" if world.site == "cloud" else "cloud")
    elif kind == "cut":
        world.cut("both")
        world.rest(CUT_S)
        world.cut(None)
    else:
        os.kill(int((world.system.temporary / "robot" / "relay.pid").read_text()), signal.SIGKILL)
    world.until(lambda: len(world.answers) >= known + ALIVE, f"results of goals, {kind}")
    return Moment(kind, begin_s, at_s, steady_s())
