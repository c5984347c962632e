"""Starting: with parts missing, in a graph that forbids it, with bad parameters, twice; the agent says what to do."""

from collections.abc import Callable

import pytest
from lifecycle_msgs.srv import ChangeState

from tests.ros.agent.ears import wait_until
from tests.ros.agent.harness import PROCESSES, World

EXIT_S = 60


def node_state(world: World) -> str:
    """What the robot's diagnostics say of its node."""
    status = world.ear.diagnostics.get("node walker")
    return status.message if status else ""


def problem(world: World, reason: str) -> str:
    """The message of a problem in the robot's diagnostics, "" while it has none."""
    status = world.ear.diagnostics.get("data")
    return status.values.get(reason, "") if status else ""


@pytest.mark.core
def test_the_robot_acts_without_a_cloud_and_uses_it_when_it_comes(build: Callable[..., World]) -> None:
    world = build()
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot")
    world.until(world.driver.drives, "the driver drives")
    world.until(lambda: world.site == "robot", "the robot is announced")
    world.start_agent("cloud")
    world.start_node("cloud")
    world.goes_to("cloud")
    world.check()


def test_a_node_that_never_comes_and_is_not_core_holds_up_none_that_is_declared_behind_it(
    build: Callable[..., World],
) -> None:
    world = build(both={"nodes": ["planner", "walker"]})
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot")
    world.until(world.driver.drives, "the driver drives")
    world.until(lambda: "planner" in problem(world, "Degraded"), "the absent one is named")


def test_the_cloud_acts_for_a_robot_whose_nodes_are_absent_and_they_stand_by_when_they_come(
    build: Callable[..., World],
) -> None:
    world = build()
    world.start_agent("robot")
    world.until(lambda: world.driver.inhibited, "the driver is inhibited while nobody can act")
    world.start_agent("cloud")
    world.start_node("cloud")
    world.goes_to("cloud")
    world.until(world.driver.drives, "the driver is released")
    world.start_node("robot")
    world.until(lambda: node_state(world) == "inactive", "the robot's node stands by")
    world.check()


def test_a_second_publisher_of_the_public_topic_ends_the_start_and_is_named(build: Callable[..., World]) -> None:
    world = build()
    world.ear.feed("/command", 1.0)
    agent = world.start_agent("robot")
    assert agent.wait(EXIT_S) == 4
    log = world.processes.log("robot-agent")
    assert "/command has another publisher: /ear;" in log
    assert "/offload/robot/command" in log


def test_a_second_publisher_that_comes_later_is_a_problem_but_ends_nothing(build: Callable[..., World]) -> None:
    world = build()
    agent = world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot", 40)
    world.ear.feed("/command", 0.1)
    world.until(lambda: problem(world, "SecondPublisher"), "it is told")
    world.kill("robot", "collector")
    world.passes("robot", 40)
    assert agent.poll() is None


def test_a_missing_interface_type_ends_the_start_and_names_the_package(build: Callable[..., World]) -> None:
    world = build(robot={"output.command.type": "absent_msgs/msg/Thing"})
    assert world.start_agent("robot").wait(EXIT_S) == 4
    assert "package absent_msgs" in world.processes.log("robot-agent")


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_bad_parameter_values_end_the_start_and_each_is_named(build: Callable[..., World], side: str) -> None:
    world = build(both={"mode": "Sometimes", "lease_ms": -1.0, "output.command.topic": "no slash", "unheard_of": 1})
    assert world.start_agent(side).wait(EXIT_S) == 2
    log = world.processes.log(f"{side}-agent")
    for name in ("mode", "lease_ms", "output.command.topic", "unheard_of"):
        assert f"robot-offload-agent: parameter {name}: " in log


def test_a_missing_certificate_ends_the_start_and_is_named(build: Callable[..., World]) -> None:
    world = build(robot={"link.certificate": "/nowhere/robot.pem"})
    assert world.start_agent("robot").wait(EXIT_S) == 2
    assert "/nowhere/robot.pem" in world.processes.log("robot-agent")


def test_a_second_agent_of_the_identity_on_this_host_is_refused_and_the_first_goes_on(
    build: Callable[..., World],
) -> None:
    world = build()
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot")
    assert world.start_agent("robot", name="second").wait(EXIT_S) == 3
    assert "runs on this host already" in world.processes.log("second-agent")
    world.passes("robot", 10)
    world.check()


def test_a_second_agent_of_another_identity_in_front_of_the_same_consumers_is_refused(
    build: Callable[..., World],
) -> None:
    world = build()
    world.start_agent("robot")
    world.start_node("robot")
    world.passes("robot")
    folder = str(world.folder / "other")
    other = world.start_agent("robot", name="other", uid="another", runtime_dir=folder, state_dir=folder)
    assert other.wait(EXIT_S) == 4
    assert "/command in domain" in world.processes.log("other-agent")
    world.passes("robot", 10)
    world.check()


def test_strict_refuses_a_duplicated_node_with_undeclared_topics_and_the_default_warns(
    build: Callable[..., World],
) -> None:
    world = build()
    world.start_node("robot", extra_topic="/secret", serves=True)
    agent = world.start_agent("robot")
    world.until(lambda: "/secret" in world.processes.log("robot-agent"), "the warning")
    world.until(lambda: problem(world, "UndeclaredPublisher"), "the problem in diagnostics")
    world.until(lambda: problem(world, "UndeclaredServer"), "what nobody declared is served")
    line = "actions: [{name: /count, type: test_msgs/action/Fibonacci, onSwitch: Abort}, {name: /many,"
    assert line in world.processes.log("robot-agent")
    assert agent.poll() is None
    world.kill_agent("robot")
    strict = world.start_agent("robot", strict=True)
    assert strict.wait(EXIT_S) == 4
    assert "/secret" in world.processes.log("robot-agent").rpartition("ERROR")[2]
    silent = world.start_agent("robot", strict=True, silent=["secret", "count", "many", "ask", "do"])
    world.until(lambda: world.site == "robot", "the robot acts, nobody outside its side needs that topic")
    assert silent.poll() is None


def test_a_lifecycle_node_that_runs_in_the_cloud_only_is_brought_up_there_before_any_robot_comes(
    build: Callable[..., World],
) -> None:
    world = build(cloud={"nodes": ["mapper", "walker"], "node.mapper.duplicated": False})
    world.start_agent("cloud")
    world.start_node("cloud", other="mapper")
    diagnostics = world.cloud_ear().diagnostics
    world.until(lambda: diagnostics["node mapper"].message == "active", "the mapper is active")


def test_a_robot_that_finds_no_cloud_says_where_it_looks_for_it(build: Callable[..., World]) -> None:
    world = build()
    world.start_agent("robot")
    address = f"quic/127.0.0.1:{world.wire.port('pulse-udp')}" if world.wire else ""
    world.until(lambda: world.reason == "NeverHeard" and address in world.message, "the address is in the placement")


def test_a_node_without_a_lifecycle_and_a_misspelt_one_are_named_with_the_cure(build: Callable[..., World]) -> None:
    world = build(robot={"nodes": ["walker", "ear", "mappper"], "node.mappper.duplicated": False})
    world.start_agent("robot")
    world.start_node("robot", other="mapper")
    world.until(lambda: "lifecycle: false" in problem(world, "NotLifecycle"), "the plain node is named")
    world.until(lambda: "/mapper does" in problem(world, "NodeMissing"), "the misspelt node is named")


def test_a_second_lifecycle_manager_is_named_and_strict_refuses_it(build: Callable[..., World]) -> None:
    world = build()
    other = world.ear.node.create_client(ChangeState, "/walker/change_state")
    agent = world.start_agent("robot")
    world.until(lambda: "/ear" in problem(world, "SecondLifecycleManager"), "the second manager is named")
    assert agent.poll() is None
    world.ear.node.destroy_client(other)
    world.until(lambda: not problem(world, "SecondLifecycleManager"), "it is gone")
    world.ear.node.create_client(ChangeState, "/walker/change_state")
    world.kill_agent("robot")
    assert world.start_agent("robot", strict=True).wait(EXIT_S) == 4
    assert "/ear changes the state of walker as well" in world.processes.log("robot-agent")


def test_a_duplicated_node_without_a_replica_is_told(build: Callable[..., World]) -> None:
    world = build()
    world.start_agent("cloud")
    world.start_agent("robot")
    world.start_node("robot")
    world.until(lambda: "walker" in problem(world, "ReplicaMissing"), "the missing replica is told")
    world.start_node("cloud")
    world.until(lambda: not problem(world, "ReplicaMissing"), "it is told no longer")


@pytest.mark.core
@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_an_agent_that_is_told_to_end_ends_all_its_processes_with_0(build: Callable[..., World], side: str) -> None:
    world = build()
    agent = world.start_agent(side)
    world.until(lambda: all(world.pid(side, process) for process in PROCESSES[side]), "all processes run")
    agent.terminate()
    assert agent.wait(EXIT_S) == 0
    assert wait_until(lambda: not list((world.folder / side).glob("*.sock")), EXIT_S)
    assert not list((world.folder / side).glob("*.pid"))
