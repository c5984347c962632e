"""Stories of nodes without a lifecycle: they run on both sides, one side is heard, and that they live is seen."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec
from robot_offload_sim.stories.stage import Stage

FOREVER_S = 1e9
TRACKER = NodeSpec("controller", core=True, lifecycle=False, hot=True)


def plain_nodes_on_both_sides() -> None:
    """A node without a lifecycle runs on both sides; consumers hear one, and a cut or a wish costs no wake-up."""
    stage = Stage(nodes=(TRACKER,))
    stage.in_cloud()
    stage.expect(stage.active("robot") and stage.active("cloud"), "both replicas run")
    start_s = stage.now
    for site in (Site.ROBOT, Site.CLOUD, Site.ROBOT, Site.CLOUD):
        stage.pin(site)
        stage.until(lambda wanted=site: stage.site is wanted, 2.0, "pinned")  # type: ignore[misc]
        stage.run(0.5)
    gap_s = stage.longest_gap(start_s)
    stage.expect(gap_s < 0.06, f"a commanded change leaves a gap of {gap_s * 1e3:.0f} ms")
    cut_s = stage.now
    stage.cut()
    stage.until_heard(cut_s + 0.02, Site.ROBOT, 0.17, "the robot's first command after a cut")


def plain_node_that_is_not_there() -> None:
    """A replica without a lifecycle that does not run keeps the cloud out; one that dies later ends the stay."""
    stage = Stage(nodes=(TRACKER,))
    stage.start()
    stage.cloud.nodes["controller"].kill(4.0)
    stage.always(lambda: stage.phase is not Phase.CLOUD, 3.5, "the cloud has no replica")
    stage.expect(stage.cloud.control.guardian.nodes[-1].state is not State.ACTIVE, "nobody takes it for alive")
    stage.until_phase(Phase.CLOUD, 8.0, "the cloud is used when the replica runs")
    stage.run(1.0)
    stage.cloud.nodes["controller"].kill(FOREVER_S)
    stage.until_phase(Phase.ROBOT, 0.5, "its silence ends the stay")
    stage.always(lambda: stage.phase is not Phase.CLOUD, 3.0, "the robot acts")


def plain_node_missing_on_the_robot() -> None:
    """A CORE node without a lifecycle that is missing on the robot stops the wheels, unless the cloud acts."""
    stage = Stage(nodes=(TRACKER,))
    stage.start()
    stage.robot.nodes["controller"].kill(FOREVER_S)
    stage.until_phase(Phase.CLOUD, 12.0, "the cloud helps a robot that cannot act")
    stage.until(lambda: not stage.driver.inhibited, 2.0, "and the wheels are free")
    stage.cut()
    stage.until_inhibited(2.0, "nobody drives the robot")


STORIES = (plain_nodes_on_both_sides, plain_node_that_is_not_there, plain_node_missing_on_the_robot)
