"""A node with state goes on where its replica was: after planned changes, a sudden loss, a killed process."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from std_msgs.msg import String

from tests.ros.agent.ears import Ear
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


@pytest.mark.core
def test_a_count_goes_on_through_changes_losses_and_a_killed_process(build: Callable[..., World]) -> None:
    world = build(program=PROGRAM, both=DECLARED).start()
    world.until(lambda: len(world.arrivals) > 160, "the cloud counts")
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


def problem(ear: Ear, reason: str) -> str:
    """The message of a problem in the diagnostics of the agent on the ear's side, "" while it has none."""
    status = ear.diagnostics.get("data")
    return status.values.get(reason, "") if status else ""


FOLLOWS_S = 15.0
LOOK_S = 0.5
SETTINGS = {"states": ["walker_1"], "state.walker_1.node": "walker", "state.walker_1.kind": "Parameters"}


def test_parameters_follow_the_acting_side_at_once_again_after_activation_and_through_a_loss(
    build: Callable[..., World],
) -> None:
    world = build(program=PROGRAM, both=SETTINGS).start()
    laps = world.ear.hear(String, "/lap")

    def drives(pace: str) -> None:
        begun = len(laps)
        world.until(lambda: any(said.data.startswith(f"{pace} ") for _, said in laps[begun:]), f"the robot is {pace}")

    def follows(pace: str, ear: Ear, node: str) -> None:
        for _ in range(round(FOLLOWS_S / LOOK_S)):
            time.sleep(LOOK_S)  # each look makes a client
            if ear.get_parameter(node, "pace") == pace:
                return
        raise AssertionError(f"{node} does not follow to {pace}\n{world.processes.logs()}")

    far = world.cloud_ear()
    assert far.set_parameter("/remote_walker", "pace", "fast").successful
    follows("fast", world.ear, "/walker")
    # Its node listens since its activation only, so it has been set again.
    world.place("robot", stay=True)
    drives("fast")
    assert world.ear.set_parameter("/walker", "pace", "brisk").successful
    follows("brisk", far, "/remote_walker")
    world.place("cloud", stay=True)
    assert far.set_parameter("/remote_walker", "pace", "quick").successful
    follows("quick", world.ear, "/walker")
    # Set on the standby by somebody: the acting side is right.
    assert world.ear.set_parameter("/walker", "pace", "mine").successful
    follows("quick", world.ear, "/walker")
    world.cut("both")
    world.goes_to("robot")
    drives("quick")
    world.cut(None)
    world.place("cloud", stay=True)
    world.place("robot", stay=True)
    drives("quick")
    assert world.ear.set_parameter("/walker", "pace", "robot only").successful
    world.until(lambda: "walker.pace (too fast)" in problem(far, "ParameterRefused"), "what was refused is named")
    world.place("cloud", stay=True)  # by hand: the deadline ends the wait for that
