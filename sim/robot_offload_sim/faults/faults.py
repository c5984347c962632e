"""Seeded plans of faults, and of what people request by hand.

A plan alternates storms (faults about once a second, overlapping) with quiet stretches in which only people act: there
commanded changeovers and the return to order are judged. Every fault has an end; until then it is active.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

from robot_offload_core.control.robot import placement
from robot_offload_core.fence.token import Site
from robot_offload_sim.faults.fault_kinds import KINDS
from robot_offload_sim.faults.fault_types import Fault
from robot_offload_sim.sides.system import System

STORMS = ((3.0, 18.0), (32.0, 47.0))
"""True times between which faults start, in a stretch of 60 s."""
FAULTS_PER_S = 1.1
LINK_EVERY = 5
"""In every fifth stretch only the link fails."""
LINK_FAULTS_PER_S = 0.5
LINK = {
    "cut": 6.0,
    "clean cut": 6.0,
    "loss": 1.0,
    "data loss": 1.0,
    "slow": 1.0,
    "double": 0.5,
    "reorder": 0.5,
    "bare": 0.5,
}
AMBUSHES = 30
"""Faults per stretch that wait until a machine enters a state: chance alone rarely hits the short states."""
AMBUSHED: dict[str, tuple[tuple[str, ...], ...]] = {
    "robot ToCloud": (
        ("stall control",), ("hand", "hand"), ("freeze",), ("late cloud", "babble"), ("late cloud", "blink"),
        ("stall collector", "change of mind"),
    ),
    "robot ToRobot": (
        ("late changeover",), ("input silent",), ("stall control",), ("data loss",), ("hand",), ("blink",),
        ("stop control", "robot hangs"),
    ),
    "robot Takeover": (
        ("stop control", "robot hangs"), ("stop control", "robot hangs"), ("freeze",), ("freeze",), ("hand",),
    ),
    "robot Cloud": (
        ("brink",), ("stall control",), ("amnesia",), ("late nodes", "cut"), ("stop control", "kill collector"),
        ("outlived gate",),
    ),
    "cloud Alone": (("stall cloud",),),
    "cloud Waking": (("change of mind",), ("stall cloud",), ("other robot",), ("blink",), ("stall control",)),
    "cloud Acting": (("amnesia",),),
    "cloud LeaseExpired": (("stall cloud",), ("troubled",)),
    "cloud DuplicateIdentity": (("stall cloud",),),
    "collector robot, cloud next": (("stop control", "data loss"), ("stop control", "kill collector"), ("replay",)),
    "collector cloud, robot next": (
        ("kill control", "robot hangs"), ("stop control", "robot hangs"), ("brink",),
        ("stop control", "kill collector"), ("replay",),
    ),
    "collector fell back from robot": (("replay",),),
    "collector fell back from cloud": (("replay",),),
    "collector resumed": (("kill control",), ("replay",)),
}  # fmt: skip
"""States with ambushes, and the usual faults there; otherwise any."""
AMBUSH_DELAY_S = 0.03
HANDS = ((0.5, 26.0), (32.0, 55.0))
"""When people switch and pin; the ends of the quiet stretches are left to the machines."""
HANDS_PER_S = 0.45
SETTLE_S = 0.3
"""How long after-effects of a fault (a burst, a restart) may take to settle."""

Ambushes = dict[str, list[list["Fault"]]]


def plan(dice: random.Random, index: int) -> tuple[Fault, ...]:
    """Return the faults of one stretch; in some only the link fails, so that the product's main promise is judged."""
    names, weights = list(KINDS), [kind.weight for kind in KINDS.values()]
    per_s = FAULTS_PER_S
    if only_link(index):
        names, weights, per_s = list(LINK), [LINK[name] for name in LINK], LINK_FAULTS_PER_S
    faults = []
    for start_s, end_s in STORMS:
        at_s = start_s
        while (at_s := at_s + dice.expovariate(per_s)) < end_s:
            name = dice.choices(names, weights)[0]
            low_s, high_s = KINDS[name].lasts_s
            duration_s = low_s + (high_s - low_s) * dice.random() ** 3
            faults.append(Fault(at_s, name, min(duration_s, end_s - at_s + 1.0), dice.random()))
    return tuple(faults)


def only_link(index: int) -> bool:
    """Return whether only the link fails in this stretch."""
    return index % LINK_EVERY == LINK_EVERY - 1


def plan_ambushes(dice: random.Random, index: int) -> Ambushes:
    """Return for each state the faults that entering it triggers, one or two each time; `at_s` counts from there.

    Every third stretch (by `index`) waits for one state only, each in turn.
    """
    if only_link(index):
        return {}
    names, weights = list(KINDS), [kind.weight for kind in KINDS.values()]
    states = list(AMBUSHED)
    if index % 3 == 2:
        states = [states[index // 3 % len(states)]]
    planned: Ambushes = {}
    for _ in range(AMBUSHES):
        state = dice.choice(states)
        chosen: Sequence[str] = dice.choices(names, weights, k=dice.choice((1, 1, 2)))
        if AMBUSHED[state] and dice.random() < 0.7:
            chosen = dice.choice(AMBUSHED[state])
        together = []
        for name in chosen:
            low_s, high_s = KINDS[name].lasts_s
            duration_s = low_s + (min(high_s, 1.0) - low_s) * dice.random() ** 2
            together.append(Fault(dice.random() ** 2 * AMBUSH_DELAY_S, name, duration_s, dice.random()))
        planned.setdefault(state, []).append(together)
    return planned


class Faults:
    """Carries out a plan and knows whether anything is wrong now.

    Attributes:
        active: faults that are active now.
        ended_s: true time when the last one ended.
        injected: how many so far, by kind.
    """

    def __init__(self, run: System, faults: tuple[Fault, ...], ambushes: Ambushes) -> None:
        self.run = run
        self.ambushes = ambushes
        self.active = 0
        self.ended_s = 0.0
        self.injected: dict[str, int] = {}
        for fault in faults:
            run.world.at(fault.at_s, self._start, fault)

    def quiet_s(self) -> float:
        """Return for how long no fault has been active; 0 during a fault."""
        ended_s = max(self.ended_s, self.run.cut_short_s)
        return 0.0 if self.active else max(0.0, self.run.world.now - ended_s - SETTLE_S)

    def entered(self, state: str) -> None:
        """Trigger an ambush if one waits for a machine to enter `state` ("robot ToCloud") in a storm."""
        waiting = self.ambushes.get(state)
        now = self.run.world.now
        if waiting and any(start_s <= now < end_s for start_s, end_s in STORMS):
            for fault in waiting.pop():
                self.run.world.after(fault.at_s, self._start, fault)

    def _start(self, fault: Fault) -> None:
        run = self.run
        run.world.note("fault", fault.kind, f"for {fault.duration_s:.3f} s", f"pick {fault.pick:.3f}")
        self.active += 1
        self.injected[fault.kind] = self.injected.get(fault.kind, 0) + 1
        kind = KINDS[fault.kind]
        undo = kind.apply(run, fault)
        run.world.after(fault.duration_s, undo)
        run.world.after(fault.duration_s + kind.tail_s, self._end, fault.kind)

    def _end(self, kind: str) -> None:
        self.active -= 1
        self.ended_s = self.run.world.now
        self.run.world.note("fault over:", kind)


class Hands:
    """People: switches by hand and pins on the robot. No faults; legal at any time."""

    def __init__(self, run: System, dice: random.Random) -> None:
        self.run = run
        for start_s, end_s in HANDS:
            at_s = start_s
            while (at_s := at_s + dice.expovariate(HANDS_PER_S)) < end_s:
                if dice.random() < 0.75:
                    run.world.at(at_s, self._tell, placement.SwitchByHand(dice.choice((Site.ROBOT, Site.CLOUD))))
                else:
                    run.world.at(at_s, self._pin, dice.choice((Site.ROBOT, Site.CLOUD)), dice.uniform(0.05, 2.0))

    def _tell(self, event: placement.Event) -> None:
        self.run.world.note("by hand", event)
        self.run.robot.control.deliver(self.run.robot.control.step, event)

    def _pin(self, site: Site, duration_s: float) -> None:
        until_s = self.run.robot.host.now_s() + duration_s
        self._tell(placement.SetPin(placement.Wish(site, until_s)))
        self.run.world.after(duration_s * self.run.world.dice.uniform(0.5, 1.5), self._tell, placement.SetPin(None))
