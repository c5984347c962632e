"""A node with state goes on where its replica was: after planned changes, a sudden loss, a killed process."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

from tests.ros.agent.harness import World

PROGRAM = Path(__file__).with_name("remembering.py")
DECLARED = {
    "states": ["walker_1"],
    "state.walker_1.node": "walker",
    "state.walker_1.kind": "Snapshot",
    "state.walker_1.max_age_ms": 500.0,
    "state.walker_1.max_size": 1024,
}


def changes(world: World) -> list[tuple[int, int]]:
    """(last count of one replica, first count of the next) of each change."""
    passed = itertools.pairwise(world.arrivals)
    return [(before.sequence, after.sequence) for before, after in passed if before.producer != after.producer]


def test_a_count_goes_on_through_changes_losses_and_a_killed_process(build: Callable[..., World]) -> None:
    world = build(program=PROGRAM, both=DECLARED).start()
    world.until(lambda: len(world.arrivals) > 80, "the cloud counts")
    for side in ("robot", "cloud"):
        world.place(side, stay=True)
        before = len(world.arrivals)
        world.until(lambda begun=before: len(world.arrivals) > begun + 20, "the other side counts")  # type: ignore[misc]
    world.cut("both")
    world.goes_to("robot")
    world.cut(None)
    world.place("cloud", stay=True)
    world.kill("robot", "data")
    before = len(world.arrivals)
    world.until(lambda: len(world.arrivals) > before + 40, "the cloud counts on")
    world.place("robot", stay=True)
    taken = changes(world)
    assert len(taken) >= 5
    # A count takes 40 or 50 ms. What was counted until a loss was seen is lost; a replica that began clean would say 1.
    assert all(after > before / 2 for before, after in taken), taken
