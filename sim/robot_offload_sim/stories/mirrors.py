"""Stories of goals at a Hot standby, and of nodes that are in the cloud only (handover, rule 9 and section 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.goals.state import MIRROR_S
from robot_offload_core.words.declared import ActionSpec, OnSwitch, ServiceSpec
from robot_offload_core.words.reasons import Reason
from robot_offload_sim.sides.clients import ClientGoal
from robot_offload_sim.stories.goal_stage import FOLLOW, RELAY, GoalStage
from robot_offload_sim.stories.hot import COMMANDS, LEARNED_S
from robot_offload_sim.stories.stage import CONTROLLER, PLANNER

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD
SEARCH, DETECT = "/search", "/detect"
MIRROR = replace(
    RELAY,
    actions=(replace(RELAY.actions[0], mirror=True, hot=(ROBOT,)), *RELAY.actions[1:]),
)
OF_CLOUD = replace(
    RELAY,
    services=(*RELAY.services, ServiceSpec(DETECT, "std_srvs/srv/Trigger", "controller", of_cloud=True)),
    actions=(
        *RELAY.actions,
        ActionSpec(SEARCH, "test_msgs/action/Fibonacci", OnSwitch.ABORT, "controller", of_cloud=True),
    ),
)


def mirror_takes_over() -> None:
    """A Hot robot executes the goal all the time: after a loss it goes on in the middle of it."""
    stage = GoalStage(hot=True, relay=MIRROR)
    stage.in_cloud()
    goal = stage.goal()
    stage.until(lambda: bool(stage.copies(ROBOT, goal)), 1.0, "the robot mirrors it")
    stage.run(3.0)
    stage.expect(bool(stage.copies(ROBOT, goal)), "the mirror needs no lease")
    stage.lose_cloud()
    stage.run(0.2)
    stage.expect(stage.began(ROBOT, goal) == 1, "it goes on, it does not begin anew")
    stage.expect(goal.fed[-1][1] is ROBOT, "its feedback passes now")
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)


def mirror_in_the_cloud() -> None:
    """A Hot cloud executes the goal without a lease, for as long as the robot names it."""
    hot = tuple(replace(node, hot=True) for node in (CONTROLLER, PLANNER))
    follow = replace(MIRROR.actions[0], hot=(CLOUD,))
    stage = GoalStage(cloud_nodes=hot, relay=replace(MIRROR, actions=(follow, *MIRROR.actions[1:])))
    stage.in_cloud()
    stage.pin(ROBOT)
    stage.run(1.0)
    goal = stage.goal()
    stage.until(lambda: bool(stage.copies(CLOUD, goal)), 1.0, "the cloud mirrors it")
    stage.run(5.0)
    stage.expect(stage.began(CLOUD, goal) == 1 and bool(stage.copies(CLOUD, goal)), "it runs on without a lease")
    stage.pin(CLOUD)
    stage.until(lambda: stage.holder is CLOUD, 8.0, "the cloud holds")
    stage.run(1.0)
    stage.expect(stage.began(CLOUD, goal) == 1, "it goes on, it does not begin anew")
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)


def mirror_over_changes() -> None:
    """The robot's copy serves through the changes there and back; the cloud, which is Warm, has none meanwhile."""
    stage = GoalStage(hot=True, relay=MIRROR)
    stage.in_cloud()
    goal = stage.goal()
    for site in (ROBOT, CLOUD, ROBOT):
        stage.to(site)
        stage.run(3.0)
    stage.expect(stage.began(ROBOT, goal) == 1, "the robot began it once")
    stage.expect(not stage.copies(CLOUD, goal), "no copy is left at a Warm standby")
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)


def mirror_ends_early() -> None:
    """A mirror that ended gives no result, and is not begun again while the goal runs."""
    stage = GoalStage(hot=True, relay=MIRROR)
    stage.in_cloud()
    goal = stage.goal()
    stage.until(lambda: bool(stage.copies(ROBOT, goal)), 1.0, "the robot mirrors it")
    stage.traits(ROBOT, FOLLOW).takes_s = 0.0
    stage.run(2.0)
    stage.expect(goal.open, "the client's goal runs on")
    stage.expect(stage.began(ROBOT, goal) == 1, "the mirror is not begun again")
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)


def mirror_that_ended_early_keeps_from_a_takeover_by_silence() -> None:
    """A Hot robot whose mirror goes on takes over by one missing message; one whose mirror ended waits for a limit."""
    for ends in (False, True):
        stage = GoalStage(hot=True, relay=MIRROR, outputs=(COMMANDS,))
        stage.in_cloud()
        goal = stage.goal()
        stage.until(lambda: bool(stage.copies(ROBOT, goal)), 1.0, "the robot mirrors it")  # noqa: B023
        stage.run(LEARNED_S)
        if ends:
            stage.traits(ROBOT, FOLLOW).takes_s = 0.0
            stage.run(MIRROR_S + 1.0)
        stage.lose_cloud()
        by_silence = stage.machine.decided.reason is Reason.OUTPUT_SILENT
        stage.expect(by_silence is not ends, f"it took over: {stage.machine.decided.reason.value}")


def node_of_the_cloud_serves() -> None:
    """A node with placement Cloud serves whoever holds; without its cloud everybody is refused at once."""
    stage = GoalStage(relay=OF_CLOUD)
    stage.in_cloud()
    goal = stage.clients.send(SEARCH)
    stage.until(lambda: bool(stage.copies(CLOUD, goal)), 2.0, "the cloud's node executes it")
    stage.lose_cloud()
    stage.ends(goal, GoalStatus.ABORTED, 1.0)
    refused, call = stage.clients.send(SEARCH), stage.clients.call(DETECT)
    stage.until(lambda: refused.accepted is False and call.failures == ["CloudAway"], 0.1, "refused at once")


def _ended_by_successor(stage: GoalStage, goal: ClientGoal, join: Callable[[], None]) -> None:
    """The cloud's relay dies while the link is cut: its successor ends the copy; the goal ends well on the robot."""
    stage.handing.cloud.kill(0.3)
    stage.run(3.0)
    stage.expect(not stage.copies(CLOUD, goal), "the cloud's copy has ended")
    join()
    stage.run(2.0)
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)


def clouds_relay_dies_unheard() -> None:
    """A relay dies in the cloud while the link is cut: its successor ends what Hot nodes execute and nobody names."""
    stage = GoalStage(cloud_nodes=tuple(replace(node, hot=True) for node in (CONTROLLER, PLANNER)))
    stage.in_cloud()
    goal = stage.goal()
    join = stage.lose_cloud()
    _ended_by_successor(stage, goal, join)


def clouds_relay_dies_and_robot_hears_nobody() -> None:
    """As before, but the successor hears the robot, which cannot hear it: it must not wait for its words."""
    stage = GoalStage(drops=False, cloud_nodes=tuple(replace(node, hot=True) for node in (CONTROLLER, PLANNER)))
    stage.in_cloud()
    goal = stage.goal()
    join = stage.cut("down")
    stage.until(lambda: stage.holder is ROBOT, 2.0, "the robot takes over")
    _ended_by_successor(stage, goal, join)


STORIES = (
    mirror_takes_over, mirror_in_the_cloud, mirror_over_changes, mirror_ends_early,
    mirror_that_ended_early_keeps_from_a_takeover_by_silence, node_of_the_cloud_serves,
    clouds_relay_dies_unheard, clouds_relay_dies_and_robot_hears_nobody,
)  # fmt: skip
