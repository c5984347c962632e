"""A node with state goes on where its replica was: after planned changes, a sudden loss, a killed process."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

from std_msgs.msg import String

from tests.ros.agent.harness import World

PROGRAM = Path(__file__).with_name("remembering.py")
DECLARED = {
    "states": ["walker_1", "walker_2"],
    "state.walker_2.node": "walker",
    "state.walker_2.kind": "Topic",
    "state.walker_2.topic": "/lap",
    "state.walker_2.restore": "/set_lap",
    "state.walker_1.node": "walker",
    "state.walker_1.kind": "Snapshot",
    "state.walker_1.max_age_ms": 500.0,
    "state.walker_1.max_size": 1024,
}


def changes(world: World) -> list[tuple[int, int]]:
    """(last count of one replica, first count of the next) of each change."""
    passed = itertools.pairwise(world.arrivals)
    return [(before.sequence, after.sequence) for before, after in passed if before.producer != after.producer]


def lap(message: String) -> int:
    return int(message.data.partition("#")[2])


def test_a_count_goes_on_through_changes_losses_and_a_killed_process(build: Callable[..., World]) -> None:
    world = build(program=PROGRAM, both=DECLARED).start()
    world.until(lambda: len(world.arrivals) > 80, "the cloud counts")
    laps = world.ear.hear(String, "/lap")
    for side in ("robot", "cloud"):
        world.place(side, stay=True)
        before = len(world.arrivals)
        world.until(lambda begun=before: len(world.arrivals) > begun + 20, "the other side counts")  # type: ignore[misc]
    # The robot's replica has gone on from the topic's message, which it was given when it listened.
    assert max(lap(message) for _, message in laps) > 80
    world.cut("both")
    world.goes_to("robot")
    world.cut(None)
    heard = len(laps)
    world.until(lambda: len(laps) > heard + 3, "the robot's laps after the loss")
    assert lap(laps[heard + 3][1]) > 80
    world.place("cloud", stay=True)
    world.kill("robot", "data")
    before = len(world.arrivals)
    world.until(lambda: len(world.arrivals) > before + 40, "the cloud counts on")
    world.place("robot", stay=True)
    taken = changes(world)
    counters = world.ear.diagnostics["data"].values
    assert 0 <= int(counters["state walker_1.age_at_change_ms"]) <= 2000
    assert len(taken) >= 5
    # A count takes 40 or 50 ms. What was counted until a loss was seen is lost; a replica that began clean would say 1.
    assert all(after > before / 2 for before, after in taken), taken
