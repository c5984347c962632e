"""A Hot robot executes goals and calls beside the cloud: after a loss it goes on in the middle of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from test_msgs.action import Fibonacci

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.clients import CANCELED, SUCCEEDED, Goal, action_client
from tests.ros.agent.harness import World
from tests.ros.agent.test_services import BasicTypes, Caller, executed


def hot(side: str) -> dict[str, Any]:
    """What makes the replica of a side Hot, and its actions and services with it."""
    served = ("action.count", "action.many", "service.do", "service.ask")
    return {f"node.walker.standby_{side}": "Hot", **{f"{name}.hot": [side] for name in served}}


HOT = {
    **hot("robot"),
    "action.count.mirror": True,
    "service.do.mode": "Race",
    "action.many.timeout_ms": 20_000.0,
}

QUIET_S = 1.0
"""Fifty ticks of a goal that is executed."""
HERE_ONLY = 7777
"""An order that the cloud's `/many` refuses, see `counting.py`."""


def test_a_hot_robot_goes_on_with_the_clouds_goal_and_answers_beside_it(build: Callable[..., World]) -> None:
    world = build(serves=True, both=HOT).start()
    count = action_client(world.ear.node, "/count")
    goal = Goal(count, 400).accepted()
    goal.beats(80)
    world.cut("both")
    world.goes_to("robot")
    goal.beats()
    turns = [
        (before[2], after[2])
        for before, after in zip(goal.feedback, goal.feedback[1:], strict=False)
        if before[1] != after[1]
    ]
    assert len(turns) == 1
    assert turns[0][1] > turns[0][0] / 2, "the robot's copy counts on, it does not begin anew"
    assert goal.result() == (SUCCEEDED, world.nodes["robot"].pid)
    assert len(goal.results) == 1
    world.cut(None)
    world.place("cloud", stay=True)
    do = Caller(world.ear, BasicTypes, "/do")
    do.more()
    do.stop()
    world.until(lambda: len(do.answers) == do.asked, "an answer to every call")
    assert {len(answers) for answers in do.answers.values()} == {1}
    for side, ear in (("robot", world.ear), ("cloud", world.cloud_ear())):
        world.until(
            lambda side=side, ear=ear: sorted(executed(world, ear, side)) == [*range(do.asked)],  # type: ignore[misc]
            f"the {side}'s replica has executed each call once",
        )
    do.close()
    count.destroy()
    world.place("robot", stay=True)
    a_pin_goes_on_without_a_goal(world)


def a_pin_goes_on_without_a_goal(world: World) -> None:
    """The stay is Degraded while the goal that the cloud's server refuses is offered to it."""
    many = action_client(world.ear.node, "/many")
    goal = Goal(many, HERE_ONLY).accepted()
    goal.beats()
    world.override("Cloud")
    world.until(lambda: world.site == "cloud", "the deadline ends the wait")
    said = "GoalsPending: "
    world.until(lambda: said in world.ear.diagnostics["data"].values.get("Degraded", ""), "the stay is Degraded")
    assert goal.cancel() == 0
    assert goal.result()[0] == CANCELED
    many.destroy()


def test_a_new_relay_of_the_cloud_ends_the_goals_of_the_one_before_although_it_hears_a_robot_that_hears_nobody(
    build: Callable[..., World],
) -> None:
    world = build(serves=True, both=hot("cloud")).start()
    world.place("cloud", stay=True)
    in_cloud = world.cloud_ear().hear(Fibonacci.Impl.FeedbackMessage, "/offload/cloud/many/_action/feedback")
    many = action_client(world.ear.node, "/many")
    goal = Goal(many, 10_000).accepted()
    goal.beats()
    world.until(lambda: in_cloud, "the cloud's server executes it")
    world.kill("cloud", "relay")
    world.cut("down")  # the robot's hellos still arrive
    world.goes_to("robot")
    world.until(lambda: now_s() - in_cloud[-1][0] > QUIET_S, "a Hot server in the cloud executes it no longer")
    goal.beats()
    assert goal.executors()[-1] == world.nodes["robot"].pid
    world.cut(None)
    assert goal.cancel() == 0
    assert goal.result()[0] == CANCELED
    assert len(goal.results) == 1
    many.destroy()
