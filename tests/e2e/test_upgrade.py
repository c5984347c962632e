"""Case 6: our chart is upgraded and rolled back while a robot drives in the cloud."""

from __future__ import annotations

from pathlib import Path

from tests.e2e.chart import Chart
from tests.e2e.faults import BACK_S, SETTLED_S, WHEELCHAIR, arrived, drive, until_cloud
from tests.e2e.figures import figure
from tests.e2e.images import renamed
from tests.e2e.robot import Robot
from tests.e2e.story import CONNECTED, READY, Story
from tests.e2e.waiting import eventually


def test_a_robot_steps_aside_for_an_upgrade_and_a_rollback_and_loses_nothing(
    story: Story, chart: Chart, tmp_path: Path
) -> None:
    now = story.images.references["agent"]
    later = f"{now}-later"
    story.cluster.import_images(renamed(story.images, now, later, tmp_path))
    robot = drive(story)
    assert _agent_image(story) == now

    figure("helm upgrade to operator ready", chart.upgrade(images__agent=later), "s")
    _wait_agent(story, robot, later)
    figure("helm rollback to operator ready", chart.rollback(), "s")
    _wait_agent(story, robot, now)
    story.wait_conditions(WHEELCHAIR, *CONNECTED)

    arrived(robot, asked=2)


def _wait_agent(story: Story, robot: Robot, image: str) -> None:
    """Waits until the agent of this image is ready and the robot drives in the cloud again."""
    eventually(lambda: _agent_image(story) == image, f"an agent of {image}", patience_s=BACK_S)
    story.wait_conditions(WHEELCHAIR, *READY)
    until_cloud(robot)
    robot.rest(SETTLED_S)


def _agent_image(story: Story) -> str:
    containers = [each for pod in story.pods(WHEELCHAIR, "agent") for each in pod["spec"]["containers"]]
    return next((str(each["image"]) for each in containers if each["name"] == "agent"), "")
