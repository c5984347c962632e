"""Stories of the user's nodes and the driver: who is brought up, who is judged, when the wheels are stopped."""

from __future__ import annotations

from typing import Any

from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.settings import OutputSpec, Settings
from robot_offload_sim.stories.stage import ARM, CONTROLLER, Stage
from robot_offload_sim.world.scenario import Replica

UNRATED = (OutputSpec("cmd_vel", 0.0),)
TWO: dict[str, Any] = {
    "nodes": (CONTROLLER, ARM),
    "outputs": (OutputSpec("cmd_vel", 0.15), OutputSpec("arm", 0.2)),
    "replicas": {"controller": Replica(0, 0.05), "arm": Replica(1, 0.05)},
}
FOREVER_S = 1e9


def inhibited_by_silence() -> None:
    """The driver is inhibited when a rated output of the robot is silent, each of them, and released afterwards."""
    stage = Stage(**TWO)
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.5)
    for name in ("controller", "arm"):
        stage.expect(not stage.driver.inhibited, "the driver is free")
        node = stage.robot.nodes[name]
        node.hung = 1
        stage.until(lambda: stage.driver.inhibited, 0.6, f"{name} is silent: the driver is inhibited")
        node.hung = 0
        stage.until(lambda: not stage.driver.inhibited, 0.6, "the driver is released")
        stage.run(0.5)


def inhibited_by_death() -> None:
    """The driver is inhibited when a CORE node of the robot dies that no rated output speaks for."""
    stage = Stage(outputs=UNRATED)
    stage.start(cloud=False)
    stage.robot_acts()
    stage.run(1.5)
    stage.expect(not stage.driver.inhibited, "the driver is free")
    stage.robot.nodes["controller"].kill(FOREVER_S)
    grace_s = stage.scenario.settings.activation_deadline_s
    stage.until(lambda: stage.driver.inhibited, 2.0 + grace_s + 0.2, "a dead CORE node stops the driver")


def forgetful_driver() -> None:
    """A driver that restarts while the fault stands is inhibited again."""
    stage = Stage()
    stage.start(cloud=False)
    stage.robot_acts()
    stage.hush("robot")
    stage.until(lambda: stage.driver.inhibited, 1.0, "inhibited")
    stage.driver.kill(0.05)
    stage.run(0.06)
    stage.until(lambda: stage.driver.inhibited, 0.7, "a driver that has forgotten is told again")


def restarted_node() -> None:
    """A node that died and is back unconfigured is found and brought up again; refusals do not make us give up soon."""
    stage = Stage(outputs=UNRATED)
    stage.start(cloud=False)
    stage.robot_acts()
    node = stage.robot.nodes["planner"]
    node.kill(0.3)
    stage.run(0.31)
    stage.until(lambda: stage.active("robot", "planner"), 3.0, "a node that is back is brought up again")
    node.refusing = 1
    node.kill(0.3)
    stage.run(4.0)
    node.refusing = 0
    stage.until(lambda: stage.active("robot", "planner"), 6.0, "a node that refused for seconds is asked again")


def unanswered_transition() -> None:
    """A transition without an answer is followed by a read and not by a second call."""
    stage = Stage(nodes=(CONTROLLER, ARM))
    stage.start(cloud=False)
    stage.robot_acts()
    node = stage.robot.nodes["arm"]
    calls: list[object] = []
    change = node.change_state
    node.change_state = lambda t, c, a: (calls.append(t), change(t, c, a))  # type: ignore[method-assign,assignment,func-returns-value]
    node.slow_s = 2.6
    node.kill(0.1)
    stage.run(8.0)
    stage.expect(len(calls) == len(set(calls)), f"asked {len(calls)} times for {len(set(calls))} transitions")


def one_of_two_core_nodes() -> None:
    """A robot with one of two CORE nodes dead is not ready: the cloud goes on, and the attempt ends at its deadline."""
    stage = Stage(**TWO)
    stage.in_cloud()
    stage.robot.nodes["arm"].kill(FOREVER_S)
    stage.run(2.5)
    start_s = stage.now
    stage.by_hand(Site.ROBOT)
    stage.until(lambda: stage.phase is Phase.TO_ROBOT, 0.2, "the robot gets ready")
    stage.run(0.05)
    stage.expect(not stage.armed, "a robot that is not ready is not offered")
    stage.until(lambda: stage.phase is Phase.CLOUD, 2.0, "the attempt is called off at its deadline")
    stage.run(0.5)
    stage.expect(stage.site is Site.CLOUD, "the cloud goes on")
    stage.expect(stage.longest_gap(start_s) < 0.1, "without a gap")


def attempts_grow_apart() -> None:
    """Attempts that fail come less often each time."""
    stage = Stage()
    stage.start()
    stage.cloud.nodes["controller"].refusing = 1
    stage.run(12.0)
    begun = [at_s for at_s, d in stage.seen.decisions if d.phase is Phase.TO_CLOUD]
    stage.expect(2 <= len(begun) <= 5, f"{len(begun)} attempts in 12 s")


def silent_cloud_output() -> None:
    """A rated output of the cloud that falls silent ends its stay."""
    stage = Stage()
    stage.in_cloud()
    stage.hush("cloud")
    stage.lost(0.15 + 0.1, "a silent output of the cloud")


def busy_node_in_the_cloud() -> None:
    """A CORE node of the cloud that answers no read for seconds is alive while its outputs flow, and dead without."""
    stage = Stage()
    stage.in_cloud()
    node = stage.cloud.nodes["controller"]
    node.get_state = lambda *_: None  # type: ignore[method-assign]
    stage.always(lambda: stage.phase is Phase.CLOUD, 4.0, "a busy node ends the stay")
    stage.hush("cloud")
    stage.run(0.5)
    stage.expect(not stage.cloud.control.guardian.flowing, "a node that neither answers nor publishes counts as alive")


def dead_cloud_node() -> None:
    """A CORE node of the cloud that dies ends its stay, also when no rated output speaks for it."""
    stage = Stage(outputs=UNRATED)
    stage.in_cloud()
    stage.cloud.nodes["controller"].kill(FOREVER_S)
    stage.lost(2.3, "a dead CORE node of the cloud")


def stale_input() -> None:
    """A required input that no longer reaches the cloud ends its stay; nothing leaves under the new epoch."""
    stage = Stage()
    stage.in_cloud()
    stage.system.silent_inputs.append(0)
    stage.lost(0.3 + 0.2, "a stale input")
    stage.run(0.3)


def late_core_node_in_the_cloud() -> None:
    """The cloud is in charge only once all its CORE nodes are Active."""
    stage = Stage(nodes=(CONTROLLER, ARM))
    stage.start()
    stage.cloud.nodes["arm"].slow_s = 0.3
    stage.until(lambda: stage.phase is Phase.CLOUD, 6.0, "the cloud is in charge")
    stage.expect(stage.active("cloud", "arm"), "with every CORE node Active")


def order_of_bring_up() -> None:
    """CORE nodes are brought up in their order: a later one waits for an earlier one that is on its way."""
    stage = Stage(nodes=(CONTROLLER, ARM))
    stage.robot.nodes["controller"].slow_s = 0.1
    stage.start(cloud=False)
    stage.until(lambda: stage.active("robot", "arm"), 3.0, "the arm is up")
    stage.expect(stage.active("robot", "controller"), "the controller was up before it")


def helped_by_the_cloud() -> None:
    """A robot that cannot act is helped by the cloud, also while attempts are put off for long."""
    stage = Stage()
    stage.start()
    stage.cloud.nodes["controller"].refusing = 1
    stage.until(lambda: stage.machine.failures >= 4, 20.0, "four attempts have failed")
    stage.cloud.nodes["controller"].refusing = 0
    stage.robot.nodes["controller"].kill(FOREVER_S)
    stage.until(lambda: stage.phase is Phase.CLOUD, 4.5, "the cloud helps a robot that cannot act")


def helped_although_preferred() -> None:
    """The same when the robot is preferred."""
    stage = Stage(settings=Settings(prefer=Site.ROBOT))
    stage.start()
    stage.robot_acts()
    stage.run(2.0)
    stage.expect(stage.site is Site.ROBOT, "the robot is preferred")
    stage.robot.nodes["controller"].kill(FOREVER_S)
    stage.until(lambda: stage.phase is Phase.CLOUD, 4.5, "the cloud helps a robot that cannot act")


STORIES = (
    inhibited_by_silence,
    inhibited_by_death,
    forgetful_driver,
    restarted_node,
    unanswered_transition,
    one_of_two_core_nodes,
    attempts_grow_apart,
    silent_cloud_output,
    busy_node_in_the_cloud,
    dead_cloud_node,
    stale_input,
    late_core_node_in_the_cloud,
    order_of_bring_up,
    helped_by_the_cloud,
    helped_although_preferred,
)
