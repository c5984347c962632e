"""Who hears whom: revoked robots, other robots' certificates (case 4), and two robots side by side (case 5)."""

from __future__ import annotations

import time

from robot_offload.api.v1alpha1 import RobotOffload
from tests.e2e.figures import figure
from tests.e2e.robot import Robot
from tests.e2e.story import READY, Story
from tests.e2e.transports_parts import (
    IN_VAIN_S,
    answers_of,
    application,
    asked_in,
    knocked,
    pod_of,
    said,
)
from tests.e2e.waiting import eventually

ZENOH = {"type": "Zenoh"}
EVERYTHING_PASSES = {
    "apiVersion": "networking.k8s.io/v1",
    "kind": "NetworkPolicy",
    "metadata": {"name": "everything-passes"},
    "spec": {"podSelector": {}, "policyTypes": ["Ingress", "Egress"], "ingress": [{}], "egress": [{}]},
}


def test_a_revoked_robot_can_no_longer_join_until_it_has_a_new_bundle(story: Story) -> None:
    robot = _acting_in_the_cloud(story, story.apply(application(story, "lost", ZENOH)))
    assert knocked(robot, robot)["opened"], "the robot's certificate does not even open a session before"

    revoked_s = time.monotonic()
    story.offload_command("revoke", "lost", "--yes")
    robot.until_site("robot")
    story.wait_conditions("lost", *READY)
    figure("revoke to a cloud with the new authority", time.monotonic() - revoked_s, "s")
    heard = robot.heard("cloud")
    robot.rest(IN_VAIN_S)
    assert robot.site == "robot"
    assert robot.heard("cloud") == heard
    eventually(lambda: story.conditions("lost")["Connected"]["status"] == "False", "the robot to count as away")
    for way in ((), ("--fallback",)):
        refused = knocked(robot, robot, *way)
        assert not refused["opened"], f"the revoked certificate still opens a session {way}"

    robot.install(story.bundle("lost"))
    robot.end("agent")
    joined_s = time.monotonic()
    robot.start_agent()
    robot.until_site("cloud")
    figure("robot with the new bundle to placement cloud", time.monotonic() - joined_s, "s")
    robot.until(lambda: robot.heard("cloud") > heard, "a message from the cloud")


def test_another_robots_certificate_opens_no_session_and_hears_nothing(story: Story) -> None:
    robot = _acting_in_the_cloud(story, story.apply(application(story, "mine", ZENOH)))
    other = story.apply(application(story, "theirs", ZENOH))
    story.wait_conditions("theirs", *READY)
    stranger = story.robot(other)

    own = knocked(robot, robot)
    assert own["opened"]
    assert own["heard"], "with its own certificate a robot hears its cloud"
    assert all("/cloud/data/" in key for key in own["heard"]), "a copy of the robot's certificate hears the robot"
    assert knocked(stranger, stranger)["opened"], "the stranger's certificate is good for its own cloud"
    for way in ((), ("--fallback",)):
        refused = knocked(stranger, robot, *way)
        assert not refused["opened"], f"another robot's certificate opens a session {way}"
        assert refused["heard"] == []
    assert robot.site == "cloud"


def test_two_robots_with_the_same_names_and_domains_do_not_hear_each_other(story: Story) -> None:
    names = ("left", "right")
    applied = [story.apply(application(story, name, ZENOH)) for name in names]
    left, right = (_acting_in_the_cloud(story, each) for each in applied)

    story.offload_command("pin", "left", "robot")
    left.until_site("robot")
    heard = right.heard("cloud")
    right.until(lambda: right.heard("cloud") > heard + 30, "the other robot to go on in the cloud")
    assert right.site == "cloud"

    pods = {name: pod_of(story, name, "answering") for name in names}
    for name in names:
        assert said(asked_in(story, pods[name], "cloud")) == answers_of(name), "it hears its own robot's nodes"
    # A participant that is deliberately wrong: it looks for others where only the other robot's nodes do.
    wrong = {"ROS_DISCOVERY_SERVER": _servers(story, "right")}
    assert asked_in(story, pods["left"], "cloud", patience_s=IN_VAIN_S, environment=wrong) == {}
    story.kubectl.apply(EVERYTHING_PASSES)  # policies add up: with this one there is none
    assert said(asked_in(story, pods["left"], "cloud", environment=wrong)) == answers_of("right"), (
        "the rules keep it away"
    )


def _acting_in_the_cloud(story: Story, offload: RobotOffload) -> Robot:
    story.wait_conditions(offload.metadata.name, *READY)
    robot = story.robot(offload)
    robot.listen()
    robot.start_nodes()
    robot.start_agent()
    robot.until_site("cloud")
    robot.until(lambda: robot.heard("cloud") > 0, "a message from the cloud")
    return robot


def _servers(story: Story, name: str) -> str:
    """The discovery servers as the pods of a RobotOffload know them."""
    pod = story.kubectl.json("get", "pod", pod_of(story, name, "answering"))
    environment = pod["spec"]["containers"][0]["env"]
    return next(str(each["value"]) for each in environment if each["name"] == "ROS_DISCOVERY_SERVER")
