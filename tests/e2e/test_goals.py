"""Case 9: a goal that a client on the robot gave once has one result, whatever becomes of who works on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from robot_offload_lab.judge import handed
from tests.e2e.faults import (
    SETTLED_S,
    WHEELCHAIR,
    arrived,
    away_and_back,
    delete_pod,
    kill_process,
    pids_of,
    pod_of,
    until_cloud,
)
from tests.e2e.figures import figure
from tests.e2e.images import APP, renamed
from tests.e2e.robot import EXAMPLES, Robot
from tests.e2e.story import READY, Manifest, Story

GOAL_M: Final = 50.5
SLOW_MPS: Final = 0.2
"""As fast as the wheelchair drives until the last fault is over: it is on its way for four minutes, and the faults take
one where the machine is idle."""
FAST_MPS: Final = 0.9
ARRIVAL_S: Final = 300.0
"""For the rest of the way, of which the robot drives some slowly when the machine is busy."""
CUT_S: Final = 3.0


def example(story: Story) -> Manifest:
    """The wheelchair of the examples, with the images of this cluster."""
    manifest: Manifest = yaml.safe_load((EXAMPLES / WHEELCHAIR / "robotoffload.yaml").read_text(encoding="utf-8"))
    for node in duplicated(manifest):
        node["image"] = story.images.references[APP]
    return manifest


def duplicated(manifest: Manifest) -> list[dict[str, Any]]:
    """Returns its nodes on both sides."""
    return [node for node in manifest["spec"]["nodes"] if node["placement"] == "Duplicated"]


def farther(manifest: Manifest) -> Manifest:
    """A longer corridor, a goal at its end, and a wheelchair that takes its time."""
    base, passenger = (node["run"]["parameters"] for node in manifest["spec"]["nodes"][:2])
    base["corridor_length"], passenger["goals_m"] = GOAL_M + 1.5, [GOAL_M]
    for parameters in ("parameters", "cloudParameters"):
        controller(manifest)["run"][parameters]["max_speed"] = SLOW_MPS
    return manifest


def controller(manifest: Manifest) -> dict[str, Any]:
    """Returns the node that drives."""
    return next(node for node in duplicated(manifest) if node["name"] == "controller")


def drive_to(story: Story, manifest: Manifest) -> Robot:
    """Starts everything; returns when the cloud works on the goal."""
    offload = story.apply(manifest)
    story.wait_conditions(WHEELCHAIR, *READY)
    robot = story.robot(offload)
    robot.listen()
    robot.begin()
    robot.start_nodes()
    robot.start_agent()
    until_cloud(robot)
    goes_on(robot)
    return robot


def goes_on(robot: Robot) -> None:
    """Waits until there is more feedback of the goal, which has not ended."""
    assert robot.consumer is not None
    watch = robot.consumer.watch

    def feedback() -> int:
        return watch.goals[1].feedback if 1 in watch.goals else 0

    heard = feedback()
    robot.until(lambda: feedback() > heard + 5, "feedback of the goal")
    assert not watch.goals[1].ending, "the goal has ended before the faults have"


@pytest.mark.timeout(1200)
def test_one_goal_has_one_result_through_killed_relays_an_outage_a_killed_pod_and_a_rolled_image(
    story: Story, tmp_path: Path
) -> None:
    manifest = farther(example(story))
    robot = drive_to(story, manifest)

    kill_process(robot.agent_pids, "relay")
    goes_on(robot)
    agent = pod_of(story, WHEELCHAIR, "agent")
    kill_process(lambda: pids_of(agent, "agent"), "relay")
    goes_on(robot)

    robot.host.wire.set(cut="both")
    robot.until_site("robot")
    goes_on(robot)
    robot.rest(CUT_S)
    robot.host.wire.set(cut=None)
    until_cloud(robot)
    goes_on(robot)

    driver = next(pod for pod in story.pods(WHEELCHAIR, "node") if "controller" in pod["metadata"]["name"])
    delete_pod(story, driver, "--grace-period=0", "--force")
    away_and_back(robot)
    goes_on(robot)

    now = story.images.references[APP]
    story.cluster.import_images(renamed(story.images, {now: f"{now}-later"}, tmp_path))
    for node in duplicated(manifest):
        node["image"] = f"{now}-later"
    controller(manifest)["run"]["cloudParameters"]["max_speed"] = FAST_MPS
    story.apply(manifest)
    away_and_back(robot)
    goes_on(robot)

    assert robot.consumer is not None
    watch = robot.consumer.watch
    robot.until(lambda: bool(watch.goals[1].ending), "the result of the goal", patience_s=ARRIVAL_S)
    robot.rest(SETTLED_S)
    # A client finds the successor of its relay by DDS, which takes up to some seconds, and nobody answers the one call
    # that was open when the robot's relay was killed (OpenCallsLost).
    measures = arrived(robot, but=frozenset({"GoalGap", "CallLost"}))
    calls = handed.calls(measures.recording)
    assert calls is not None
    assert calls.unanswered <= 1
    [goal] = handed.goals(measures.recording)
    figure("goal accepted after", goal.last.accepted_ms, "ms")
    figure("restarts of the goal", goal.restarts)
    figure("longest silence of the goal's feedback", goal.silence_ms, "ms")
    assert (goal.ending, goal.last.results, goal.last.backwards) == (handed.SUCCEEDED, 1, 0)
