"""The user's nodes die, come back, refuse and dawdle; the robot keeps its commands or its driver is inhibited."""

import pytest
from lifecycle_msgs.srv import ChangeState

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.ears import Ear
from tests.ros.agent.harness import World
from tests.ros.agent.passage import UNDISTURBED_S, holes, longest_gap_s

GAP_LIMIT_S = 5.0


def problem(ear: Ear, reason: str) -> str:
    """The message of a problem in the diagnostics of the agent on the ear's side, "" while it has none."""
    status = ear.diagnostics.get("data")
    return status.values.get(reason, "") if status else ""


@pytest.mark.core
def test_the_robot_takes_over_when_the_clouds_node_dies_and_gives_back_when_it_is_restarted(world: World) -> None:
    at_s = world.kill_node("cloud")
    world.goes_to("robot")
    assert longest_gap_s(world.arrivals, at_s) < GAP_LIMIT_S
    named = ("OutputSilent", "CloudNodesDown", "CloudNotActing")
    world.until(lambda: any(p.t_s > at_s and p.reason in named for p in world.placed), "the reason")
    world.start_node("cloud")
    world.goes_to("cloud")


def test_an_output_of_half_a_megabyte_passes_from_the_cloud(world: World) -> None:
    world.place("robot", stay=True)
    world.kill_node("cloud")
    world.start_node("cloud", padding=500_000)
    world.place("cloud")
    since = len(world.arrivals)
    world.passes("cloud", 20)
    assert all(len(a.producer) > 500_000 for a in world.arrivals[since:] if a.site == "cloud")
    world.kill_node("cloud")
    world.start_node("cloud")
    world.place("cloud")


@pytest.mark.core
def test_the_cloud_takes_over_when_the_robots_core_node_dies(world: World) -> None:
    world.place("robot")
    at_s = world.kill_node("robot")
    world.goes_to("cloud")
    assert longest_gap_s(world.arrivals, at_s) < 2 * GAP_LIMIT_S
    world.until(lambda: not world.driver.inhibited, "the driver is released")
    world.start_node("robot")
    world.until(lambda: world.ear.diagnostics["node walker"].message == "inactive", "the node stands by")


def test_the_driver_is_inhibited_when_the_core_node_dies_and_nobody_else_may_act(world: World) -> None:
    world.place("robot", stay=True)
    world.until(lambda: not world.driver.inhibited, "the driver drives")
    world.kill_node("robot")
    world.until(lambda: world.driver.inhibited, "the driver is inhibited")
    world.start_node("robot")
    world.passes("robot")
    world.until(world.driver.drives, "the driver is released and drives")


def test_a_node_that_restarts_while_it_acts_is_brought_back(world: World) -> None:
    world.place("robot", stay=True)
    world.kill_node("robot")
    world.start_node("robot")
    world.passes("robot", 10)
    world.until(world.driver.drives, "the driver drives")


def test_a_refused_activation_in_the_cloud_leaves_the_robot_acting_and_is_tried_again(world: World) -> None:
    world.place("robot", stay=True)
    assert world.cloud_ear().set_parameter("/remote_walker", "refuse", True).successful
    since, at_s = len(world.arrivals), now_s()
    world.override("Cloud")
    world.until(lambda: any(p.t_s > at_s and p.reason == "CloudNotReady" for p in world.placed), "it is called off")
    world.until(lambda: sum(p.t_s > at_s and p.phase == "ToCloud" for p in world.placed) > 1, "it is tried again")
    assert {a.site for a in world.arrivals[since:]} == {"robot"}
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    assert holes(world.arrivals[since:]) == 0
    assert "walker" in world.processes.log("cloud-agent").partition("was refused")[0].splitlines()[-1]
    assert world.cloud_ear().set_parameter("/remote_walker", "refuse", False).successful
    world.goes_to("cloud")


def test_a_refused_activation_on_the_robot_leaves_the_cloud_acting(world: World) -> None:
    assert world.ear.set_parameter("/walker", "refuse", True).successful
    since, at_s = len(world.arrivals), now_s()
    world.override("Robot")
    world.until(lambda: any(p.t_s > at_s and p.reason == "RobotNotReady" for p in world.placed), "it is called off")
    assert {a.site for a in world.arrivals[since:]} == {"cloud"}
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    assert holes(world.arrivals[since:]) == 0
    assert world.ear.set_parameter("/walker", "refuse", False).successful
    world.goes_to("robot")


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_a_heavy_activation_costs_a_commanded_switch_no_command(world: World, side: str) -> None:
    other = {"robot": "cloud", "cloud": "robot"}[side]
    world.place(other, stay=True)
    ear, node = (world.ear, "/walker") if side == "robot" else (world.cloud_ear(), "/remote_walker")
    assert ear.set_parameter(node, "activation_s", 0.3).successful
    since, at_s = len(world.arrivals), now_s()
    world.place(side, stay=True)
    assert longest_gap_s(world.arrivals, at_s) < UNDISTURBED_S
    assert holes(world.arrivals[since:]) == 0
    assert ear.set_parameter(node, "activation_s", 0.0).successful


def test_a_heavy_activation_after_a_sudden_loss_inhibits_the_driver_until_the_node_acts(world: World) -> None:
    assert world.ear.set_parameter("/walker", "activation_s", 1.0).successful
    orders = len(world.driver.orders)
    world.cut("both")
    world.goes_to("robot")
    world.until(lambda: not world.driver.inhibited, "the driver is released")
    assert [inhibit for _, inhibit in world.driver.orders[orders:]][:1] == [True]
    assert world.ear.set_parameter("/walker", "activation_s", 0.0).successful


def test_a_parameter_that_differs_is_named_on_both_sides_ends_no_stay_and_hinders_the_next(world: World) -> None:
    ears = (world.ear, world.cloud_ear())
    assert ears[1].set_parameter("/remote_walker", "extra_topic", "/other").successful
    for ear in ears:
        world.until(lambda ear=ear: "walker (extra_topic)" in problem(ear, "ReplicaParametersDiffer"), "it is named")
    world.until(lambda: "extra_topic" in problem(world.ear, "Degraded"), "the stay goes on without it")
    assert world.site == "cloud"
    world.cut("both")
    world.goes_to("robot")
    world.cut(None)
    world.until(lambda: world.reason == "ReplicaParametersDiffer", "the policy waits for equal parameters")
    world.place("cloud")
    world.place("robot")
    world.until(lambda: world.reason == "ReplicaParametersDiffer", "the policy waits again")
    assert ears[1].set_parameter("/remote_walker", "extra_topic", "").successful
    world.goes_to("cloud")
    for ear in ears:
        world.until(lambda ear=ear: not problem(ear, "ReplicaParametersDiffer"), "nothing differs any more")


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_a_second_lifecycle_manager_on_either_side_refuses_the_cloud_while_it_is_there(world: World, side: str) -> None:
    ear, node = (world.ear, "/walker") if side == "robot" else (world.cloud_ear(), "/remote_walker")
    client = ear.node.create_client(ChangeState, f"{node}/change_state")
    world.until(lambda: world.site == "robot" and world.reason == "SecondLifecycleManager", "the robot acts")
    assert "changes the state of walker as well" in world.message
    ear.node.destroy_client(client)
    world.goes_to("cloud")
