"""Lifecycle nodes that a manager activates and deactivates: alone, among others, heavy, many at once, over the link."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload_lab.bench.analysis import lifecycle
from robot_offload_lab.bench.analysis.lifecycle import BASELINE, Rounds, TransitionCase
from robot_offload_lab.bench.plan import Order
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.stage import Stage
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.two_hosts import TwoHosts

LINK: Final = LinkOptions(delay="10ms")
WORK_MS: Final = 50.0
REST_MS: Final = (10.0, 60.0)
"""Between two transitions, at random: the nodes' timers are met in every phase."""
MANAGER: Final = "manager"
LIGHT: Final = "light"
OTHERS: Final = tuple(f"other_{number}" for number in range(20))
OTHER_PROCESSES: Final = 2
TEN: Final = tuple(f"ten_{number}" for number in range(10))
ALONE: Final = TransitionCase(BASELINE, "one node alone", "1-12 ms")
HEAVY: Final = TransitionCase(
    "heavy", f"a heavy node, {WORK_MS:g} ms of work in its callbacks", "up to 60 ms (deactivation)"
)
AMONG: Final = TransitionCase("among", "one node among 20 active others", "1-12 ms")
TOGETHER: Final = TransitionCase("together", "10 nodes at once, each a process")
ACROSS: Final = TransitionCase("across", "manager and node on two hosts, 10ms each way", "1-12 ms (LAN)")
CASES: Final = (ALONE, HEAVY, AMONG, TOGETHER, ACROSS)
WORKER: Final = "robot_offload_lab.bench.parts.worker"


def run(order: Order) -> GroupResult:
    """Measure the cases on this host one after the other, then the one on two hosts."""
    found = []
    with _stage(order, "lifecycle") as stage:
        if order.wants(ALONE.name):
            found.append(_measure(stage, order, ALONE, _started(stage, [(LIGHT,)])))
        if order.wants(HEAVY.name):
            heavy = ("heavy",)
            found.append(_measure(stage, order, HEAVY, _started(stage, [heavy], "--work", WORK_MS)))
            stage.end(heavy[0])
        if order.wants(AMONG.name):
            found.append(_measure_among(stage, order))
        if order.wants(TOGETHER.name):
            found.append(_measure(stage, order, TOGETHER, _started(stage, [(name,) for name in TEN])))
    why = TwoHosts.refusal() if order.wants(ACROSS.name) else ""
    if order.wants(ACROSS.name) and not why:
        with TwoHosts(LINK, order.seed) as hosts, _stage(order, "lifecycle-hosts", hosts) as stage:
            found.append(_measure(stage, order, ACROSS, _started(stage, [(LIGHT,)])))
    return lifecycle.outcome(order.priority, found, {ACROSS.title: why} if why else {})


def _measure_among(stage: Stage, order: Order) -> Rounds:
    """Measure one node while others are active beside it."""
    light = (LIGHT,) if LIGHT in stage.said else _started(stage, [(LIGHT,)])
    share = len(OTHERS) // OTHER_PROCESSES
    groups = [OTHERS[first : first + share] for first in range(0, len(OTHERS), share)]
    _started(stage, groups, "--active")
    rounds = _measure(stage, order, AMONG, light)
    for group in groups:
        stage.end(group[0])
    return rounds


def _stage(order: Order, name: str, hosts: TwoHosts | None = None) -> Stage:
    return Stage(order.folder(name), realtime=order.realtime, domain=order.domain, hosts=hosts)


def _started(stage: Stage, groups: Sequence[Sequence[str]], *options: object) -> tuple[str, ...]:
    """Start nodes, each group a process, and wait until the manager can ask them."""
    for group in groups:
        stage.start(group[0], WORKER, *group, *options, host="cloud")
    if MANAGER not in stage.said:
        stage.start(MANAGER, "robot_offload_lab.bench.parts.manager", host="robot")
    names = tuple(name for group in groups for name in group)
    stage.ask(MANAGER, {"find": names}, f"the manager finds {names[0]}")
    return names


def _measure(stage: Stage, order: Order, case: TransitionCase, names: Sequence[str]) -> Rounds:
    stage.rest(1.0)  # discovery among all of them comes to rest
    what = f"the rounds of {case.title!r} end"
    said = stage.ask(MANAGER, {"nodes": names, "rounds": order.amounts.rounds, "rest_ms": REST_MS}, what, 600.0)
    return Rounds.from_json(case, said)
