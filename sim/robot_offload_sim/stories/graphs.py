"""Stories of ordinary ROS graphs: many nodes, dead ones, idle, slow and unrated outputs, timers made at activation."""

from __future__ import annotations

from dataclasses import replace

from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.settings import NodeSpec, OutputSpec, Settings
from robot_offload_sim.stories.stage import CONTROLLER, PLANNER, Stage
from robot_offload_sim.world.scenario import Replica

FOREVER_S = 1e9
MAP = NodeSpec("map_server")


def dead_node_before_the_core() -> None:
    """A node that is not CORE, is declared first and is dead for good, holds up no other node after a loss."""
    stage = Stage(nodes=(MAP, PLANNER, CONTROLLER))
    stage.in_cloud()
    stage.robot.nodes["map_server"].kill(FOREVER_S)
    stage.robot.nodes["planner"].refusing = 1
    stage.run(3.0)
    cut_s = stage.now
    stage.cut()
    stage.until_heard(cut_s + 0.08, Site.ROBOT, 0.6, "the robot's first command")
    stage.always(lambda: not stage.driver.inhibited, 3.0, "and nobody stops the wheels")


def idle_outputs() -> None:
    """Rated outputs that both sides leave idle do not send placement to and fro."""
    stage = Stage()
    stage.in_cloud()
    stage.hush("robot")
    stage.hush("cloud")
    stage.run(2.0)
    epoch = stage.machine.epoch
    stage.run(15.0)
    stage.expect(stage.machine.epoch - epoch <= 8, f"{stage.machine.epoch - epoch} epochs in 15 s of idleness")


def nothing_to_hear() -> None:
    """Outputs without a rate that publish nothing change over anyway: a pin is obeyed in both directions."""
    stage = Stage(
        nodes=(replace(PLANNER, core=True),),
        outputs=(OutputSpec("plan", 0.0),),
        replicas={"planner": Replica(0, 3600.0)},
    )
    stage.in_cloud()
    stage.pin(Site.ROBOT)
    stage.until_phase(Phase.ROBOT, 1.5, "pinned to the robot")
    stage.pin(Site.CLOUD)
    stage.until_phase(Phase.CLOUD, 2.5, "pinned to the cloud")
    stage.expect(stage.seen.changeovers["sudden"] == 0, "in order")


def slow_timers_made_at_activation() -> None:
    """Outputs of one message a second, from timers that are made at activation, change over both ways."""
    settings = Settings(robot_period_s=1.0, cloud_period_s=1.0, activation_deadline_s=0.25)
    stage = Stage(
        settings=settings, outputs=(OutputSpec("cmd_vel", 1.5),),
        replicas={"controller": Replica(0, 1.0, on_activate=True)},
    )  # fmt: skip
    stage.start()
    stage.until_phase(Phase.CLOUD, 12.0, "the cloud is in charge")
    stage.run(3.0)
    stage.expect(stage.phase is Phase.CLOUD, "the cloud stays in charge")
    stage.by_hand(Site.ROBOT)
    stage.until_phase(Phase.ROBOT, 4.0, "the robot acts as asked")
    stage.always(lambda: not stage.driver.inhibited, 3.0, "the driver is free")


def stall_inhibits_nobody() -> None:
    """A stall of control alone, on a robot that acts, inhibits nobody."""
    stage = Stage()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.5)
    for _ in range(4):
        stage.stall(stage.robot.control, 0.4)
        stage.always(lambda: not stage.driver.inhibited, 1.0, "a stall of control inhibits the driver")


def many_nodes() -> None:
    """Seven nodes with slow transitions: the first command after a cut comes within the sum of the CORE ones."""
    names = ("a", "b", "c", "d", "e")
    nodes = (*(NodeSpec(name) for name in names), CONTROLLER, NodeSpec("arm", core=True))
    stage = Stage(nodes=nodes, transition_s=0.06)
    stage.in_cloud()
    cut_s = stage.now
    stage.cut()
    stage.until_heard(cut_s + 0.08, Site.ROBOT, 0.09 + 2 * 0.08 + 0.35, "the robot's first command")


def different_settings() -> None:
    """Sides with different leases agree on the shorter one: nothing leaves later than either allows."""
    for robot_s, cloud_s in ((0.25, 0.6), (0.6, 0.25)):
        stage = Stage(settings=Settings(lease_s=robot_s), cloud_settings=Settings(lease_s=cloud_s))
        stage.in_cloud()
        stage.stall(stage.robot.control, 1.0)
        stage.run(2.0)


STORIES = (
    dead_node_before_the_core,
    idle_outputs,
    nothing_to_hear,
    slow_timers_made_at_activation,
    stall_inhibits_nobody,
    many_nodes,
    different_settings,
)
