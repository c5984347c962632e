"""The whole robot of examples/sedia: 22 managed nodes, a patrol, and a link that fails; its own images and messages."""

from __future__ import annotations

from typing import Final

import pytest

from robot_offload_lab.judge import handed
from tests.e2e.faults import SETTLED_S, Manifest, arrived, until_cloud
from tests.e2e.figures import figure, tell
from tests.e2e.images import Images, provide_example
from tests.e2e.robot import Robot
from tests.e2e.story import CONNECTED, READY, Story
from tests.e2e.waiting import eventually

SEDIA: Final = "sedia"
ROUNDS: Final = 3
"""Of the patrol, so that there is a goal all the time."""
CUT_S: Final = 3.0
CUTS: Final = 2


@pytest.fixture
def own(story: Story) -> Images:
    """The example's images, on the nodes of the cluster."""
    images = provide_example(SEDIA, tell)
    story.cluster.import_images(*images.archives)
    return images


def patrol(story: Story, images: Images) -> Manifest:
    """The sample with these images and several rounds."""
    manifest = story.sample(SEDIA)
    for node in manifest["spec"]["nodes"]:
        if "image" in node:
            node["image"] = images.references[f"examples/{SEDIA}"]
        if node["name"] == "waypoint_follower":
            node["run"]["parameters"]["waypoints"] *= ROUNDS
    manifest["spec"]["cloud"]["agent"]["image"] = images.references[f"examples/{SEDIA}-agent"]
    return manifest


def goals(robot: Robot) -> int:
    """How many goals of the patrol have succeeded so far."""
    assert robot.consumer is not None
    return sum(goal.ending == handed.SUCCEEDED for goal in robot.consumer.watch.goals.values())


@pytest.mark.timeout(1200)
def test_22_nodes_go_on_with_their_patrol_while_the_link_fails(story: Story, own: Images) -> None:
    manifest = patrol(story, own)
    offload = story.apply(manifest)
    story.wait_conditions(SEDIA, *READY)
    pods = story.pods(SEDIA, "node")
    assert len(pods) == sum("image" in node for node in manifest["spec"]["nodes"])
    robot = story.robot(offload, example=SEDIA)
    robot.listen()
    robot.begin()
    robot.start_nodes()
    robot.start_agent()
    until_cloud(robot)
    story.wait_conditions(SEDIA, *CONNECTED)
    figure("managed nodes", len(offload.spec.nodes))
    figure("pods of nodes", len(pods))

    for _ in range(CUTS):
        robot.host.wire.set(cut="both")
        robot.until_site("robot")
        robot.rest(CUT_S)
        robot.host.wire.set(cut=None)
        until_cloud(robot)
        robot.rest(SETTLED_S)
    done = goals(robot)
    robot.until(lambda: goals(robot) > done + 1, "two more goals of the patrol", patience_s=120.0)
    eventually(lambda: story.placement(SEDIA) == "Cloud", "placement Cloud in the status")

    measures = arrived(robot)
    ended = handed.goals(measures.recording)
    figure("goals", len(ended))
    figure("goals that succeeded", sum(goal.ending == handed.SUCCEEDED for goal in ended))
    figure("restarts of goals", sum(goal.restarts for goal in ended))
    assert {goal.ending for goal in ended[:-1]} == {handed.SUCCEEDED}
    assert all(goal.last.results <= 1 for goal in ended)
