"""Stories of goals that nodes of the group give to a server outside it (handover, rule 11)."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_sim.sides.outside import UsedGoal
from robot_offload_sim.stories.goal_stage import LIFT, GoalStage

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD


def _running(stage: GoalStage, goal: UsedGoal) -> bool:
    return bool(stage.handing.outside.servers.running(goal.number))


def _sent(stage: GoalStage, site: Site) -> UsedGoal:
    goal = stage.handing.outside.send(site, LIFT)
    stage.until(lambda: _running(stage, goal), 1.0, "the server outside executes it")
    return goal


def used_goal_of_the_holder() -> None:
    """A goal of the cloud's node is executed on the robot; a standby's is refused at once."""
    stage = GoalStage()
    stage.in_cloud()
    refused = stage.handing.outside.send(ROBOT, LIFT)
    goal = _sent(stage, CLOUD)
    stage.expect(refused.accepted is False, "the standby's goal is refused")
    stage.until(lambda: goal.fed > 0, 1.0, "its client hears feedback")
    stage.handing.outside.servers.traits[LIFT].takes_s = 0.0
    stage.until(lambda: goal.results == [GoalStatus.SUCCEEDED], 1.0, "its client has the result")


def used_goal_over_a_change() -> None:
    """The old side's goal ends soon after the change, or when the new side's is accepted."""
    stage = GoalStage()
    stage.in_cloud()
    first = _sent(stage, CLOUD)
    stage.to(ROBOT)
    stage.run(0.2)
    stage.expect(_running(stage, first), "it is not ended at once")
    stage.until(lambda: not _running(stage, first), 1.0, "it ends after cancelAfter")
    stage.until(lambda: first.results == [GoalStatus.ABORTED], 1.0, "its client never asked for that")
    second = _sent(stage, ROBOT)
    stage.hush("cloud")
    stage.by_hand(CLOUD)
    stage.until(lambda: stage.armed, 3.0, "the cloud is ready")
    third = stage.handing.outside.send(CLOUD, LIFT)
    stage.until(lambda: third.accepted is True, 0.5, "a candidate's goal is accepted at once")
    stage.expect(not _running(stage, third), "and waits")
    stage.cloud.nodes["controller"].hung = 0
    stage.until(lambda: stage.holder is CLOUD, 3.0, "the cloud holds")
    stage.until(lambda: _running(stage, third), 0.4, "its goal is offered")
    stage.until(lambda: not _running(stage, second), 0.4, "the old side's goal makes way for it")


def used_goal_after_a_loss() -> None:
    """The cloud is lost: its goal outside ends, the robot's begins only when the cloud has stopped for sure."""
    stage = GoalStage()
    stage.in_cloud()
    lost = _sent(stage, CLOUD)
    stage.lose_cloud()
    mine = stage.handing.outside.send(ROBOT, LIFT)
    stage.until(lambda: _running(stage, mine), 2.0, "the robot's goal begins")
    stage.until(lambda: not _running(stage, lost), 1.0, "the cloud's ends")


def relays_die_with_used_goals() -> None:
    """The robot's relay goes on with the goals of both sides; those of a dead cloud relay's clients are ended."""
    stage = GoalStage()
    stage.in_cloud()
    stage.pin(CLOUD)
    goal = _sent(stage, CLOUD)
    stage.handing.robot.kill(0.1)
    stage.run(1.0)
    stage.expect(_running(stage, goal), "it runs on")
    stage.handing.outside.servers.traits[LIFT].takes_s = 0.0
    stage.until(lambda: goal.results == [GoalStatus.SUCCEEDED], 2.0, "its client has the result")
    stage.handing.outside.servers.traits[LIFT].takes_s = float("inf")
    orphan = _sent(stage, CLOUD)
    stage.handing.cloud.kill(0.1)
    stage.until(lambda: not _running(stage, orphan), 2.0, "nobody could end it any more")


STORIES = (used_goal_of_the_holder, used_goal_over_a_change, used_goal_after_a_loss, relays_die_with_used_goals)
