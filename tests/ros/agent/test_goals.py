"""A client of an action on the robot cannot tell that its server moved: one handle, feedback forward, one result."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from rclpy.action import ActionClient

from robot_offload.api.side_numbers import parse_numbers
from tests.ros.agent.clients import ABORTED, CANCELED, SUCCEEDED, Goal, action_client, until
from tests.ros.agent.harness import World
from tests.ros.agent.lifting import Lift

SHOWN_S = 60.0


@pytest.fixture
def count(serving_world: World) -> Iterator[ActionClient]:
    client = action_client(serving_world.ear.node, "/count")
    yield client
    client.destroy()


@pytest.fixture
def many(serving_world: World) -> Iterator[ActionClient]:
    client = action_client(serving_world.ear.node, "/many")
    yield client
    client.destroy()


def in_flight(world: World, action: str) -> tuple[int, ...]:
    """Goals that execute and that wait, and restarts, as the reporter reads them in the cloud.

    Raises:
        KeyError: there is no report of the robot.
    """
    numbers = parse_numbers(world.state["robot"])
    if numbers is None:
        raise KeyError("robot")
    return dict(numbers.actions)[action]


def examined(world: World) -> str:
    """What the doctor beside the robot's agent says of goals and calls in flight, "" where it heard no agent."""
    words = [sys.executable, "-m", "robot_offload_agent.main", "doctor", "--json", "--no-network"]
    file = str(world.folder / "robot.yaml")
    done = subprocess.run([*words, "--params", file], capture_output=True, text=True, timeout=2 * SHOWN_S, check=False)
    return next((one["message"] for one in json.loads(done.stdout) if one["check"] == "InFlight"), "")


def went_over(goal: Goal, world: World, *sides: str) -> bool:
    """Whether these sides executed a goal in this order; on a busy machine it may have moved more often."""
    executors = iter(goal.executors())
    return all(world.nodes[side].pid in executors for side in sides)


@pytest.mark.core
def test_a_goal_goes_on_through_commanded_switches(serving_world: World, count: ActionClient) -> None:
    goal = Goal(count, 400).accepted()
    goal.beats()
    for side in ("robot", "cloud", "robot", "cloud"):
        serving_world.place(side, stay=True)
        goal.beats()
    assert goal.result()[0] == SUCCEEDED
    assert went_over(goal, serving_world, "cloud", "robot", "cloud", "robot", "cloud")
    assert len(goal.results) == 1
    serving_world.until(lambda: in_flight(serving_world, "/count")[2] >= 4, "the restarts are shown", SHOWN_S)
    serving_world.until(lambda: "/count 0 executing, 0 waiting, " in examined(serving_world), "by the doctor", SHOWN_S)


@pytest.mark.core
def test_a_goal_goes_on_after_a_sudden_loss(serving_world: World, count: ActionClient) -> None:
    goal = Goal(count, 300).accepted()
    goal.beats()
    serving_world.cut("both")
    serving_world.goes_to("robot")
    goal.beats()
    serving_world.cut(None)
    serving_world.place("cloud", stay=True)
    goal.beats()
    assert goal.result()[0] == SUCCEEDED
    assert went_over(goal, serving_world, "cloud", "robot", "cloud")
    assert len(goal.results) == 1


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_a_cancel_ends_the_goal_on_either_side(serving_world: World, count: ActionClient, side: str) -> None:
    serving_world.place(side, stay=True)
    goal = Goal(count, 10_000).accepted()
    goal.beats()
    serving_world.until(lambda: in_flight(serving_world, "/count")[:2] == (1, 0), "it is shown in the cloud", SHOWN_S)
    assert goal.cancel() == 0
    assert goal.result()[0] == CANCELED
    serving_world.until(lambda: in_flight(serving_world, "/count")[:2] == (0, 0), "nothing is in flight", SHOWN_S)
    later = Goal(count, 5).accepted()
    heard = len(goal.feedback)
    assert later.result()[0] == SUCCEEDED
    assert len(goal.feedback) == heard


def test_a_renewed_goal_takes_the_place_of_the_one_before_through_switches(
    serving_world: World, count: ActionClient
) -> None:
    goals = []
    for side in ("robot", "cloud", "robot"):
        goals.append(Goal(count, 10_000).accepted())
        goals[-1].beats()
        serving_world.place(side, stay=True)
        goals[-1].beats()
    goals.append(Goal(count, 30).accepted())
    assert [goal.result()[0] for goal in goals] == [ABORTED] * 3 + [SUCCEEDED]


def test_the_robots_relay_serves_without_a_cloud_and_without_the_data_process(
    serving_world: World, count: ActionClient
) -> None:
    serving_world.place("robot", stay=True)
    serving_world.kill_agent("cloud")
    serving_world.signal("robot", "data", signal.SIGSTOP)
    try:
        assert Goal(count, 5).accepted().result() == (SUCCEEDED, serving_world.nodes["robot"].pid)
    finally:
        serving_world.signal("robot", "data", signal.SIGCONT)


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_a_killed_relay_of_the_robot_loses_no_goal(serving_world: World, many: ActionClient, side: str) -> None:
    serving_world.place(side, stay=True)
    goals = [Goal(many, order).accepted() for order in (150, 175, 200)]
    for goal in goals:
        goal.beats()
    serving_world.kill("robot", "relay")
    results = [goal.result() for goal in goals]
    assert results == [(SUCCEEDED, serving_world.nodes[side].pid)] * 3
    assert [len(goal.results) for goal in goals] == [1, 1, 1]


def test_a_killed_relay_of_the_cloud_loses_no_goal(serving_world: World, many: ActionClient) -> None:
    goal = Goal(many, 200).accepted()
    goal.beats()
    serving_world.kill("cloud", "relay")
    assert goal.result()[0] == SUCCEEDED
    assert len(goal.results) == 1


def test_a_server_that_dies_hands_its_goal_on(serving_world: World, count: ActionClient) -> None:
    goal = Goal(count, 150).accepted()
    goal.beats()
    os.killpg(serving_world.nodes["cloud"].pid, signal.SIGKILL)
    serving_world.goes_to("robot")
    assert goal.result() == (SUCCEEDED, serving_world.nodes["robot"].pid)
    assert len(goal.results) == 1


def test_an_action_outside_is_used_by_the_side_that_holds(serving_world: World) -> None:
    """The test's nodes play the replicas: they use the private name of their side."""
    lift = Lift(serving_world.ear.node)
    clients = {
        side: action_client(ear.node, f"/offload/{side}/lift")
        for side, ear in (("robot", serving_world.ear), ("cloud", serving_world.cloud_ear()))
    }
    standby = Goal(clients["robot"], 5)
    until(lambda: standby.handle is not None, "an answer to the standby's goal")
    assert not standby.handle.accepted
    first = Goal(clients["cloud"], 100).accepted()
    first.beats()
    serving_world.kill("robot", "relay")
    assert first.result() == (SUCCEEDED, os.getpid())
    left = Goal(clients["cloud"], 10_000).accepted()
    left.beats()
    serving_world.place("robot", stay=True)
    assert left.result()[0] == ABORTED
    until(lambda: not lift.running, "the server ends what the side left behind began")
    assert Goal(clients["robot"], 5).accepted().result()[0] == SUCCEEDED
    lift.serves = False
    for client in clients.values():
        client.destroy()
