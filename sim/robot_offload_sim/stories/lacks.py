"""Stories of what a side lacks while it gets ready, and of how a change ends without it (handover, section 8)."""

from __future__ import annotations

from dataclasses import replace

from robot_offload_core.fence.token import Site
from robot_offload_sim.stories.goal_stage import SETTINGS, GoalStage

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD


def called_off_side_settles() -> None:
    """A side that was called off for its goals stays Active for `settleFor`, and no longer."""
    stage = GoalStage(settings=replace(SETTINGS, settle_for_s=3.0))
    stage.on_robot()
    stage.goal()
    stage.traits(CLOUD).rejects += 1
    stage.pin(None)
    stage.until(lambda: stage.active("cloud", "controller"), 10.0, "the cloud gets ready")
    stage.until(lambda: "GoalsPending" in _reasons(stage), 10.0, "it is called off")
    stage.pin(ROBOT)
    stage.run(0.5)
    stage.always(lambda: stage.active("cloud", "controller"), 2.2, "it stays Active")
    stage.until(lambda: not stage.active("cloud", "controller"), 1.5, "and sleeps then")


def pin_goes_on_without_its_goal() -> None:
    """A pin changes over without the goal, and says so until its server has taken it."""
    stage = GoalStage()
    stage.on_robot()
    stage.goal()
    stage.traits(CLOUD).rejects += 1
    stage.pin(CLOUD)
    stage.until(lambda: stage.holder is CLOUD, 8.0, "the cloud holds")
    stage.until(lambda: "GoalsPending" in _degraded(stage), 1.5, "it is Degraded")
    stage.traits(CLOUD).rejects -= 1
    stage.until(lambda: not _degraded(stage), 1.5, "until the goal is accepted")


def _reasons(stage: GoalStage) -> list[str]:
    return [decided.verdict.reason.value for _, decided in stage.seen.decisions]


def _degraded(stage: GoalStage) -> str:
    found = stage.robot.control.process.degraded()
    return "" if found is None else found[1]


STORIES = (called_off_side_settles, pin_goes_on_without_its_goal)
