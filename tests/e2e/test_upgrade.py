"""Case 6: our chart is upgraded and rolled back while a robot drives in the cloud, alone and in a fleet."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.chart import Chart
from tests.e2e.faults import BACK_S, SETTLED_S, WHEELCHAIR, arrived, drive, until_cloud
from tests.e2e.figures import figure
from tests.e2e.images import renamed
from tests.e2e.robot import Robot
from tests.e2e.story import CONNECTED, READY, Story
from tests.e2e.waiting import eventually

pytestmark = pytest.mark.timeout(1200)
AWAY = tuple(f"walker{number}" for number in range(4))
AT_ONCE = 2
LIMIT_S = 240.0


def test_a_robot_steps_aside_for_an_upgrade_and_a_rollback_and_loses_nothing(
    story: Story, chart: Chart, tmp_path: Path
) -> None:
    now = story.images.references["agent"]
    later = f"{now}-later"
    story.cluster.import_images(renamed(story.images, {now: later}, tmp_path))
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


def test_an_upgrade_takes_five_robots_in_turn_and_the_one_that_its_cloud_drives_last(
    story: Story, chart: Chart, tmp_path: Path
) -> None:
    """One robot drives; four more are away: what two cores carry beside their 20 pods."""
    later = {story.images.references[name]: f"{story.images.references[name]}-fleet" for name in ("agent", "discovery")}
    story.cluster.import_images(renamed(story.images, later, tmp_path))
    for name in AWAY:
        story.apply(story.sample("talker", lambda manifest, name=name: _call(manifest, name)))
    robot = drive(story)
    for name in AWAY:
        story.wait_conditions(name, *READY, patience_s=LIMIT_S)
    eventually(lambda: story.placement(WHEELCHAIR) == "Cloud", "placement Cloud in the status")

    fleet = Fleet(story, (*AWAY, WHEELCHAIR))
    try:
        _upgrade(chart, robot, fleet, later)
    finally:
        chart.rollback()
    arrived(robot)


def _upgrade(chart: Chart, robot: Robot, fleet: Fleet, later: Mapping[str, str]) -> None:
    """Upgrades to the other names of both images, and watches who is away when."""
    began_s = time.monotonic()
    agent, discovery = later.values()
    chart.upgrade(images__agent=agent, images__discovery=discovery, maxRolling=AT_ONCE)

    def upgraded() -> bool:
        robot.rest(0.3)  # its recording goes on
        return fleet.look() and fleet.images() >= set(later.values()) and not fleet.images() & set(later)

    eventually(upgraded, "all robots to run the new images", patience_s=LIMIT_S, instead=fleet.told)
    figure("upgrade of five robots, two at a time", time.monotonic() - began_s, "s")
    figure("most robots whose pods were replaced at once", max(map(len, fleet.down)))
    assert {name for down in fleet.down for name in down} == set(fleet.names)  # each was seen while it was replaced
    assert max(map(len, fleet.down)) <= AT_ONCE, fleet.told()
    assert max(fleet.servers_down) <= 1, "both discovery servers of a robot were away at once"
    first = {name: next(number for number, down in enumerate(fleet.down) if name in down) for name in fleet.names}
    assert first[WHEELCHAIR] == max(first.values()), f"who loses nothing goes first: {first}"
    until_cloud(robot)
    robot.rest(SETTLED_S)


class Fleet:
    """What is away of some robots at each look, by one reading of all their pods."""

    def __init__(self, story: Story, names: tuple[str, ...]) -> None:
        self.names = names
        self.down: list[frozenset[str]] = []
        self.servers_down: list[int] = []
        self._story = story
        self._pods: list[dict[str, Any]] = []
        self.look()
        self._whole = self._count()
        self.down, self.servers_down = [], []

    def look(self) -> bool:
        """Reads all pods; returns whether every robot has all of them ready."""
        self._pods = self._story.kubectl.json("get", "pods")["items"]
        ready = self._count()
        whole = getattr(self, "_whole", ready)
        away = {key: whole[key] - ready[key] for key in whole}
        self.down.append(frozenset(name for (name, _), missing in away.items() if missing > 0))
        self.servers_down.append(max(missing for (_, part), missing in away.items() if part == "discovery"))
        return not self.down[-1]

    def images(self) -> set[str]:
        """The images of all containers that there are."""
        return {each["image"] for pod in self._pods for each in pod["spec"]["containers"]}

    def told(self) -> str:
        """What was away at each look that differed from the one before."""
        looks = [sorted(down) for number, down in enumerate(self.down) if not number or down != self.down[number - 1]]
        return f"{looks}"

    def _count(self) -> Counter[tuple[str, str]]:
        found: Counter[tuple[str, str]] = Counter()
        for pod in self._pods:
            labels = pod["metadata"]["labels"]
            conditions = pod["status"].get("conditions") or ()
            if any(each["type"] == "Ready" and each["status"] == "True" for each in conditions):
                found[labels["app.kubernetes.io/instance"], labels["app.kubernetes.io/component"]] += 1
        return found


def _call(manifest: dict[str, Any], name: str) -> None:
    manifest["metadata"]["name"] = name


def _agent_image(story: Story) -> str:
    containers = [each for pod in story.pods(WHEELCHAIR, "agent") for each in pod["spec"]["containers"]]
    return next((str(each["image"]) for each in containers if each["name"] == "agent"), "")
