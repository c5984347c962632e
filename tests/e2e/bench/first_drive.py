"""From `kubectl apply` to Active nodes, from the robot's start to the cloud's first command, and what pods cost."""

from __future__ import annotations

import json
import statistics
import time
from typing import Final

from robot_offload.api.agent_state import ANNOTATION, AgentState, parse_state
from robot_offload_lab.cluster.errors import CommandError
from tests.e2e.bench import pods
from tests.e2e.bench.place import Place
from tests.e2e.figures import figure
from tests.e2e.story import READY, Manifest, Story
from tests.e2e.waiting import eventually

GROUP: Final = "first-drive"
TIMES: Final = 5
TIMES_QUICK: Final = 2
DRIVE_S: Final = 20.0
NAME: Final = "wheelchair"


def measure(place: Place) -> None:
    """All of it, several times; the medians and the slowest."""
    active, drive = [], []
    for number in range(TIMES_QUICK if place.quick else TIMES):
        with place.story("first") as story:
            active.append(_active_s(story))
            drive.append(_drive_s(story, costs=number == 0))
    for name, values in (("apply to all cloud nodes Active", active), ("robot start to first cloud command", drive)):
        figure(f"{name}, median of {len(values)}", statistics.median(values), "s")
        figure(f"{name}, slowest of {len(values)}", max(values), "s")


def hot(manifest: Manifest) -> None:
    """The cloud's replica is Active all the time, so that it can be seen to become so before there is a robot."""
    for node in manifest["spec"]["nodes"]:
        if node["placement"] == "Duplicated":
            node["standby"] = {"robot": "Warm", "cloud": "Hot"}


def _active_s(story: Story) -> float:
    """From `kubectl apply` until the cloud's agent says that every node there is Active; images are on the nodes."""
    began_s = time.monotonic()
    story.apply(story.sample(NAME, hot))

    def all_active() -> bool:
        said = state(story, NAME)
        return said is not None and bool(said.nodes) and all(each == "active" for _, each in said.nodes)

    eventually(all_active, "every node in the cloud Active", instead=lambda: state(story, NAME))
    return time.monotonic() - began_s


def state(story: Story, name: str) -> AgentState | None:
    """What the cloud's agent last said about itself, from the robot's Lease; None: nothing yet."""
    try:
        lease = story.kubectl.json("get", "lease", f"{name}-robot")
    except CommandError:
        return None
    text = (lease["metadata"].get("annotations") or {}).get(ANNOTATION)
    return parse_state(text) if text and json.loads(text) else None


def _drive_s(story: Story, *, costs: bool) -> float:
    story.wait_conditions(NAME, *READY)
    offload = story.apply(story.sample(NAME, hot))
    robot = story.robot(offload)
    robot.listen()
    robot.begin()
    robot.start_nodes()
    started_s = robot.start_agent()
    robot.until(lambda: robot.heard("cloud") > 0, "a command from the cloud", patience_s=90)
    if costs:
        before = pods.read(story, NAME)
        robot.rest(DRIVE_S)
        pods.tell(before, pods.read(story, NAME))
    measures = robot.finish()
    return next(each.t_s for each in measures.recording.outputs["/cmd_vel"] if each.site == "cloud") - started_s
