"""Case 1: from `helm install` to a wheelchair that is driven from the cluster, with what a user types and no more."""

from __future__ import annotations

import time

import pytest

from tests.e2e.figures import figure
from tests.e2e.judged import assert_faultless, judged
from tests.e2e.robot import Robot
from tests.e2e.story import CONNECTED, READY, Story
from tests.e2e.waiting import eventually

DRIVE_S = 15.0


@pytest.mark.core
def test_a_robot_drives_in_the_cloud_a_minute_after_the_first_apply(story: Story) -> None:
    applied_s = time.monotonic()
    offload = story.apply(story.sample("wheelchair"))
    story.wait_conditions("wheelchair", *READY)
    figure("apply to all cloud pods ready", time.monotonic() - applied_s, "s")
    conditions = story.conditions("wheelchair")
    assert conditions["Connected"]["reason"] == "NeverConnected"

    robot = story.robot(offload)  # `kubectl offload bundle`, copied to where its README says; nothing else
    robot.listen()
    robot.begin()
    robot.start_nodes()
    started_s = robot.start_agent()
    robot.until_site("cloud", patience_s=90)
    robot.until(lambda: robot.heard("cloud") > 0, "a command from the cloud")
    robot.rest(DRIVE_S)
    story.wait_conditions("wheelchair", *CONNECTED)
    eventually(lambda: story.placement("wheelchair") == "Cloud", "placement Cloud in the status")
    # The robot has made a key of its own meanwhile; the bundle's is used up.
    story.wait_conditions("wheelchair", "CertificateCurrent")
    known = story.resource("wheelchair")["status"]["certificates"]
    assert known["robot"]["serial"] != known["bundle"]["serial"]
    for site in ("robot", "cloud", "robot"):
        figure(f"kubectl offload pin {site} to the robot's obeying it", pinned(story, robot, site), "s")
    # Back in the cloud by the policy, whose hold-down counts the changes of these minutes.
    figure("kubectl offload pin auto to the cloud's commands", pinned(story, robot, "auto"), "s")
    measures = robot.finish()

    first = next(each for each in measures.recording.outputs["/cmd_vel"] if each.site == "cloud")
    figure("robot start to first cloud command", first.t_s - started_s, "s")
    assert_faultless(judged(measures))


def pinned(story: Story, robot: Robot, site: str) -> float:
    """Pins a robot; returns the seconds until it obeys, whatever the kubelet does with ConfigMaps."""
    began_s = time.monotonic()
    story.offload_command("pin", "wheelchair", site)
    robot.until_site("cloud" if site == "auto" else site)
    return time.monotonic() - began_s
