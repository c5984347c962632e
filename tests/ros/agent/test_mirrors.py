"""A Hot robot executes goals and calls beside the cloud: after a loss it goes on in the middle of them."""

from __future__ import annotations

from collections.abc import Callable

from tests.ros.agent.clients import CANCELED, SUCCEEDED, Goal, action_client
from tests.ros.agent.harness import World
from tests.ros.agent.test_services import BasicTypes, Caller, executed

HOT = {
    "node.walker.standby_robot": "Hot",
    **{f"{name}.hot": ["robot"] for name in ("action.count", "action.many", "service.do", "service.ask")},
    "action.count.mirror": True,
    "service.do.mode": "Race",
    "action.many.timeout_ms": 20_000.0,
}


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
