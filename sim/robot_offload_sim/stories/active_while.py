"""Stories of outputs that are rated only while there is something to do (`while`)."""

from __future__ import annotations

from typing import Any

from robot_offload_core.data.process import InputPlan
from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.declared import While
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import NodeSpec, OutputSpec
from robot_offload_sim.sides.clients import ClientGoal
from robot_offload_sim.stories.goal_stage import FOLLOW, GoalStage
from robot_offload_sim.stories.stage import Stage
from robot_offload_sim.world.scenario import Replica

ROBOT, CLOUD = Site.ROBOT, Site.CLOUD
COMMANDS = OutputSpec("cmd_vel", 0.15, 0.05, while_=While(actions=(FOLLOW,)), topic="/cmd_vel")
BOTH = (ROBOT, CLOUD)


def _stage(*, always: tuple[Site, ...] = (), **changes: Any) -> GoalStage:
    """Return a stage on which the controller publishes while it executes a goal; on `always` it never stops."""
    stage = GoalStage(outputs=(changes.pop("output", COMMANDS),), **changes)
    for site, side in ((ROBOT, stage.robot), (CLOUD, stage.cloud)):
        if site not in always:
            servers = stage.handing.servers[site]
            side.nodes["controller"].occupied = lambda servers=servers: servers.busy()
    return stage


def _goal(stage: GoalStage) -> ClientGoal:
    goal = stage.goal()
    stage.run(1.0)
    return goal


def idle_robot_changes_over() -> None:
    """An idle side is not silent: it stays in charge, the wheels stay free, and a change needs no message."""
    stage = _stage()
    stage.in_cloud()
    for site in (ROBOT, CLOUD):
        stage.pin(site)
        stage.until(lambda wanted=site: stage.site is wanted, 3.0, "an idle robot changes over")  # type: ignore[misc]
        stage.run(0.5)
        stage.always(
            lambda wanted=site: stage.site is wanted and not stage.driver.inhibited,  # type: ignore[misc]
            3.0, "nothing to do is no fault",
        )  # fmt: skip
    goal = _goal(stage)
    stage.expect(stage.phase is Phase.CLOUD, "and stays when a goal begins")
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)
    stage.always(lambda: stage.phase is Phase.CLOUD and not stage.driver.inhibited, 3.0, "and when it has ended")


def silent_while_it_executes() -> None:
    """A cloud that executes and falls silent is left at the output's deadline, and the message names the output."""
    stage = _stage()
    stage.in_cloud()
    stage.run(2.0)
    _goal(stage)
    stage.hush("cloud")
    stage.lost(0.25, "silence while a goal is executed")
    decided = stage.machine.decided
    stage.expect(decided.reason is Reason.OUTPUT_SILENT and "/cmd_vel" in decided.message, "named by its topic")
    stage.until_heard(stage.now, ROBOT, 1.0, "the robot goes on with the goal")


def silent_from_the_beginning() -> None:
    """A side that executes and never says anything is silent once a node would have become Active."""
    stage = _stage()
    stage.in_cloud()
    stage.hush("cloud")
    stage.run(1.0)
    stage.expect(stage.phase is Phase.CLOUD, "nobody minds as long as nothing runs")
    stage.goal()
    stage.lost(stage.scenario.settings.activation_deadline_s + 0.15, "it never begins to publish")


def robot_silent_while_it_executes() -> None:
    """A robot that executes and falls silent is stopped; not one whose relay does not say what it executes."""
    stage = _stage()
    stage.on_robot()
    _goal(stage)
    relay = stage.handing.robot
    relay.kill(1e9)
    stage.run(0.5)
    problem = stage.robot.control.process.unjudged()
    stage.expect(problem is not None and "/cmd_vel" in problem[1], "it is said that nobody judges")
    stage.hush("robot")
    stage.always(lambda: not stage.driver.inhibited, 1.0, "nobody knows whether anything is to be done")
    relay.start()
    stage.until_inhibited(8.0, "the relay says so, the robot is silent")
    stage.let_end()
    stage.until(lambda: not stage.driver.inhibited, 3.0, "nothing is to be done any more")


def changeover_while_a_goal_runs() -> None:
    """While a goal runs a changeover waits for the first message of its copy on the other side."""
    stage = _stage()
    stage.in_cloud()
    goal = _goal(stage)
    stage.hush("robot")
    stage.pin(ROBOT)
    stage.until(lambda: stage.copies(ROBOT, goal) != [], 4.0, "the robot's copy runs")
    stage.always(lambda: stage.site is CLOUD, 0.5, "it says nothing yet")
    stage.robot.nodes["controller"].hung = 0
    stage.until(lambda: stage.site is ROBOT, 8.0, "now it does")


def end_of_a_goal_is_no_loss() -> None:
    """A Hot robot does not take the end of a goal for a lost message: no beat from later calls the output rated."""
    hot = OutputSpec("cmd_vel", 0.15, 0.05, while_=COMMANDS.while_, topic="/cmd_vel", hot=BOTH)
    stage = _stage(output=hot, always=(ROBOT,), nodes=(NodeSpec("controller", core=True, hot=True),))
    stage.in_cloud()
    goal = _goal(stage)
    stage.run(8.0)
    stage.let_end()
    stage.ends(goal, GoalStatus.SUCCEEDED)
    stage.always(lambda: stage.phase is Phase.CLOUD, 1.0, "the goal has ended")


def rated_while_a_topic_arrives() -> None:
    """An output that follows a topic is silent with it; while the topic arrives its silence is a fault."""
    output = OutputSpec("boxes", 0.15, 0.05, while_=While(topic="image", within_s=0.1), topic="/boxes")
    stage = Stage(
        outputs=(output,), replicas={"controller": Replica(0, 0.05)}, inputs=(InputPlan("image"),),
        input_periods_s=(0.05,),
    )  # fmt: skip
    for side in (stage.robot, stage.cloud):
        side.nodes["controller"].occupied = lambda: not stage.system.silent_inputs
    stage.in_cloud()
    stage.system.silent_inputs.append(0)
    stage.always(lambda: stage.phase is Phase.CLOUD and not stage.driver.inhibited, 3.0, "there is no image")
    stage.pin(ROBOT)
    stage.until(lambda: stage.site is ROBOT, 3.0, "an idle robot changes over")
    stage.always(lambda: not stage.driver.inhibited, 3.0, "there is no image here either")
    stage.pin(None)
    stage.until_phase(Phase.CLOUD, 5.0, "back")
    stage.system.silent_inputs.clear()
    stage.run(1.0)
    stage.expect(stage.phase is Phase.CLOUD, "images and boxes")
    stage.hush("cloud")
    stage.lost(0.25, "images and no boxes")


STORIES = (
    idle_robot_changes_over, silent_while_it_executes, silent_from_the_beginning, robot_silent_while_it_executes,
    changeover_while_a_goal_runs, end_of_a_goal_is_no_loss, rated_while_a_topic_arrives,
)  # fmt: skip
