"""Case 5: the nodes of a robot that is away have no pods; they are there again when it comes back."""

from __future__ import annotations

import time

from tests.e2e.faults import WHEELCHAIR, Manifest, arrived, drive, until_cloud
from tests.e2e.figures import figure
from tests.e2e.story import CONNECTED, Story
from tests.e2e.waiting import eventually


def test_nodes_of_an_absent_robot_go_and_come_back_with_it(story: Story) -> None:
    robot = drive(story, _soon_idle)
    robot.finish()

    left_s = time.monotonic()
    robot.power_off()
    eventually(lambda: not story.pods(WHEELCHAIR, "node"), "the end of the node's pod", patience_s=180.0)
    figure("robot gone to no pods of its nodes (idleTimeout 30 s)", time.monotonic() - left_s, "s")
    eventually(lambda: story.resource(WHEELCHAIR)["status"]["replicas"] == 0, "replicas 0 in the status")
    condition = story.conditions(WHEELCHAIR)["WorkloadsAvailable"]
    assert (condition["status"], condition["reason"]) == ("True", "RobotGone")
    assert len(story.pods(WHEELCHAIR, "agent")) == 1, "somebody must hear the robot return"

    back_s = time.monotonic()
    robot.listen()
    robot.begin()
    robot.start_nodes()
    robot.start_agent()
    until_cloud(robot)
    figure("robot back to its nodes Active in the cloud", time.monotonic() - back_s, "s")
    robot.rest(5.0)
    story.wait_conditions(WHEELCHAIR, *CONNECTED)
    arrived(robot)


def _soon_idle(manifest: Manifest) -> None:
    manifest["spec"]["scale"] = {"idleTimeout": "30s"}
