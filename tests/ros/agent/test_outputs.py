"""In front of the consumers: nobody else publishes, types agree, the public topic offers what the replica offers."""

from collections.abc import Callable

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from std_msgs.msg import String

from tests.ros.agent.ears import LATCHED
from tests.ros.agent.harness import World
from tests.ros.agent.test_start import problem

PLAN = {
    "outputs": ["command", "plan"],
    "output.plan.topic": "/plan",
    "output.plan.robot_topic": "/offload/robot/plan",
    "output.plan.cloud_topic": "/offload/cloud/plan",
    "output.plan.node": "walker",
}


def test_a_second_publisher_that_comes_later_takes_the_cloud_away_and_when_strict_stops_the_driver(
    build: Callable[..., World],
) -> None:
    world = build(both={"strict": True})
    world.start()
    world.until(world.driver.drives, "the driver drives")
    world.ear.feed("/command", 0.1)
    world.until(lambda: (world.site, world.reason) == ("robot", "SecondPublisher"), "the robot is in charge")
    assert "remap its output to /offload/robot/command" in world.message
    world.until(lambda: world.driver.inhibited, "the driver is inhibited")
    world.until(lambda: "ear" in problem(world, "SecondPublisher"), "the problem names who")


def test_a_second_publisher_takes_the_cloud_away_although_the_robot_cannot_act(build: Callable[..., World]) -> None:
    world = build()
    world.start()
    world.until(world.driver.drives, "the driver drives")
    world.kill_node("robot")
    world.ear.feed("/command", 0.1)
    world.until(lambda: (world.site, world.reason) == ("robot", "SecondPublisher"), "the robot is in charge")
    world.until(lambda: world.driver.inhibited, "the driver is inhibited")


def test_two_processes_of_one_node_in_the_cloud_take_it_away(build: Callable[..., World]) -> None:
    world = build(both={"node.walker.lifecycle": False}, plain=True)
    world.start()
    first = world.nodes["cloud"]
    world.start_node("cloud")
    world.until(lambda: (world.site, world.reason) == ("robot", "TwoReplicas"), "the robot is in charge")
    assert "/offload/cloud/command is published by 2 processes (/remote_walker, /remote_walker)" in world.message
    first.kill()
    world.until(lambda: world.site == "cloud", "the cloud acts again when one of the two is gone")


def test_a_replica_that_publishes_what_nobody_declared_takes_the_cloud_away_and_stops_the_driver_when_strict(
    build: Callable[..., World],
) -> None:
    world = build(both={"strict": True})
    world.start()
    world.until(world.driver.drives, "the driver drives")
    world.kill_node("robot")
    world.start_node("robot", extra_topic="/secret")
    world.until(lambda: (world.site, world.reason) == ("robot", "UndeclaredPublisher"), "the robot is in charge")
    assert "/secret" in world.message
    world.until(lambda: world.driver.inhibited, "the driver is inhibited")


def test_a_cloud_without_a_replica_on_the_robot_is_heard_with_the_type_that_the_cloud_names(
    build: Callable[..., World],
) -> None:
    world = build(both={"output.command.type": "auto"})
    world.start_agent("robot")
    world.start_agent("cloud")
    world.start_node("cloud")
    world.goes_to("cloud")
    world.check()


def test_outputs_of_different_types_keep_the_cloud_out(build: Callable[..., World]) -> None:
    world = build(robot={"output.command.type": "std_msgs/msg/String"})
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side)
    world.until(lambda: world.reason == "TypesDiffer", "the robot says that types differ")
    assert "std_msgs/msg/String" in world.message
    assert "std_msgs/msg/Header" in world.message
    assert world.site == "robot"
    assert not [each for each in world.arrivals if each.site == "cloud"]


def test_the_public_topic_offers_what_the_replicas_own_publisher_offers(build: Callable[..., World]) -> None:
    world = build(both=PLAN)
    latched = QoSProfile(
        depth=1,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        deadline=Duration(seconds=5),
        lifespan=Duration(seconds=90),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=60),
    )
    publisher = world.ear.node.create_publisher(String, "/offload/robot/plan", latched)
    publisher.publish(String(data="a plan"))
    world.start_agent("robot")
    demanding = world.ear.hear(String, "/plan", latched)
    world.until(lambda: demanding, "the plan at a consumer that asks for a deadline")
    (offered,) = (info.qos_profile for info in world.ear.node.get_publishers_info_by_topic("/plan"))
    assert (offered.lifespan, offered.liveliness, offered.liveliness_lease_duration) == (
        latched.lifespan, latched.liveliness, latched.liveliness_lease_duration,
    )  # fmt: skip
    late = world.ear.hear(String, "/plan", LATCHED)
    world.until(lambda: late, "the plan at a consumer that comes late")
    world.ear.hear(String, "/plan", QoSProfile(depth=1, deadline=Duration(seconds=1)))
    world.until(lambda: "/plan cannot be heard by ear" in problem(world, "IncompatibleQos"), "one that cannot hear")


def test_an_output_of_another_type_than_declared_is_named_with_its_node(
    build: Callable[..., World],
) -> None:
    world = build(both={"output.command.type": "std_msgs/msg/String"})
    world.start_agent("robot")
    world.start_node("robot")
    world.until(lambda: problem(world, "TypesDiffer"), "the problem in diagnostics")
    said = problem(world, "TypesDiffer")
    assert "declared as std_msgs/msg/String" in said
    assert "/walker publishes std_msgs/msg/Header" in said
