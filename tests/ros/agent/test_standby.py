"""A Hot replica takes over by a missing message; an output with `while` is silent without anybody minding."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.clients import Goal, action_client
from tests.ros.agent.harness import PATIENT, World

SLOW_LIMITS: dict[str, Any] = {
    "loss_timeout_ms": 4000.0,
    "lease_ms": 5000.0,
    "output.command.deadline_ms": 6000.0,
    "node.walker.standby_robot": "Hot",
    "node.walker.standby_cloud": "Hot",
    "output.command.hot": ["robot", "cloud"],
}
LEARNED = 130


def assert_silence_is_named(world: World) -> None:
    """The cloud's node stands still for a while: the robot takes over, and the reason names the silent output."""
    world.goes_to("cloud")
    stopped_s = now_s()
    os.killpg(world.nodes["cloud"].pid, signal.SIGSTOP)
    world.goes_to("robot")
    left = next(change for change in world.placed if change.t_s > stopped_s and change.site == "robot")
    assert left.reason == "OutputSilent"
    assert "/command" in left.message, "the silent output is named"
    os.killpg(world.nodes["cloud"].pid, signal.SIGCONT)


def test_a_hot_robot_goes_on_long_before_any_limit_breaks_and_the_heartbeats_confirm_the_loss(
    build: Callable[..., World],
) -> None:
    world = build(both=SLOW_LIMITS).start()
    world.passes("cloud", LEARNED)
    world.goes_to("cloud")
    cut_s = world.cut("both")
    world.goes_to("robot")
    taken = next(change for change in world.placed if change.t_s > cut_s and change.site == "robot")
    assert taken.reason == "OutputSilent"
    assert "/command" in taken.message
    assert taken.t_s - cut_s < SLOW_LIMITS["loss_timeout_ms"] / 1e3
    world.cut(None)
    world.goes_to("cloud")
    for side in ("robot", "cloud", "robot"):
        world.place(side, stay=True)
    world.check()


def test_an_output_with_while_is_judged_while_a_goal_is_executed(build: Callable[..., World]) -> None:
    world = build(both={**PATIENT, "output.command.while_actions": ["/many"]}, serves=True)
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side, silent_when_idle=True)
    world.until(lambda: world.site == "cloud", "an idle robot changes over to the cloud")
    idle_s, changes = now_s(), len(world.placed)
    world.until(lambda: now_s() - idle_s > 4, "nothing to do")
    assert {change.site for change in world.placed[changes:]} <= {"cloud"}, "nobody minds"

    client = action_client(world.ear.node, "/many")
    goal = Goal(client, 10_000).accepted()
    goal.beats()
    world.passes("cloud", 10)
    assert_silence_is_named(world)
    goal.beats()
    assert goal.cancel() == 0
    client.destroy()


SEEN: dict[str, Any] = {
    **PATIENT,
    "output.command.while_topic": "/image",
    "output.command.while_within_ms": 250.0,
    "inputs": ["odom", "map", "image"],
    "input.image.topic": "/image",
}


def test_an_output_with_a_topic_as_its_while_is_judged_while_that_arrives(build: Callable[..., World]) -> None:
    world = build(both=SEEN)
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side, heeds="/image")
    world.until(lambda: world.site == "cloud", "a robot that sees nothing changes over to the cloud")
    idle_s, changes = now_s(), len(world.placed)
    world.until(lambda: now_s() - idle_s > 2, "nothing to see")
    assert {change.site for change in world.placed[changes:]} <= {"cloud"}, "nobody minds"
    images = world.ear.feed("/image", 20.0)
    world.passes("cloud", 10)
    images.cancel()
    quiet_s, changes = now_s(), len(world.placed)
    world.until(lambda: now_s() - quiet_s > 2, "nothing to see any more")
    assert {change.site for change in world.placed[changes:]} <= {"cloud"}, "nobody minds"
    images.reset()
    world.passes("cloud", 10)
    assert_silence_is_named(world)
    world.check()
