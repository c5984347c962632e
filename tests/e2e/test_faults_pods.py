"""Case 4, pods: what runs in the cluster is killed while the robot drives there."""

from __future__ import annotations

from typing import Any

import pytest

from tests.e2e.chart import NAMESPACE as SYSTEM
from tests.e2e.faults import (
    SETTLED_S,
    WHEELCHAIR,
    Manifest,
    arrived,
    away_and_back,
    births,
    delete_pod,
    drive,
    kill_container,
    pod_of,
    until_cloud,
)
from tests.e2e.figures import figure
from tests.e2e.story import READY, Story
from tests.e2e.waiting import eventually

TALKER = "talker"


@pytest.mark.core
def test_a_robot_takes_over_when_the_cloud_agent_is_killed_and_gives_back_to_the_next_one(story: Story) -> None:
    robot = drive(story)

    kill_container(pod_of(story, WHEELCHAIR, "agent"), "agent")
    away_and_back(robot)

    arrived(robot)


@pytest.mark.core
def test_a_robot_drives_on_in_the_cloud_while_the_operator_is_killed_at_work(story: Story) -> None:
    robot = drive(story)
    before = births(story)

    story.apply(story.sample(TALKER))
    eventually(lambda: _there(story, "secret"), "the first object of the talker", every_s=0.0)
    kill_container(_operator(story), "operator")
    figure("objects there when the operator was killed in a create", _children(story))
    story.wait_conditions(TALKER, *READY)
    figure("objects there when all was made", _children(story))

    story.apply(story.sample(TALKER, _three_servers))
    eventually(lambda: _there(story, "service", "talker-discovery-2"), "the third server's Service", every_s=0.0)
    delete_pod(story, _operator(story), "--grace-period=0", "--force")
    story.wait_conditions(TALKER, *READY)
    assert _there(story, "statefulset", "talker-discovery-2")

    generation = _agent_generation(story)
    story.apply(story.sample(TALKER))
    eventually(lambda: _agent_generation(story) != generation, "a change of the agent", every_s=0.0)
    kill_container(_operator(story), "operator")
    eventually(
        lambda: not _there(story, "statefulset,service", "talker-discovery-2"), "the end of what is no longer declared"
    )
    story.wait_conditions(TALKER, *READY)

    assert births(story) == before, "pods that nobody touched were rolled"
    until_cloud(robot)
    arrived(robot)


def test_a_robot_takes_over_when_its_node_is_killed_also_after_the_discovery_servers_were(story: Story) -> None:
    robot = drive(story)

    for server in story.pods(WHEELCHAIR, "discovery"):
        kill_container(server, "discovery")
    eventually(lambda: _started_again(story), "the discovery servers to run again")
    robot.rest(SETTLED_S)
    until_cloud(robot)  # those who have found each other need no discovery server

    # The new node is found through the new servers, or never.
    delete_pod(story, pod_of(story, WHEELCHAIR, "node"), "--grace-period=0", "--force")
    away_and_back(robot)

    arrived(robot)


def _three_servers(manifest: Manifest) -> None:
    manifest["spec"]["cloud"] = {"discoveryServers": 3}


def _started_again(story: Story) -> bool:
    """Whether every discovery server is ready after another start."""
    servers = [each["status"]["containerStatuses"][0] for each in story.pods(WHEELCHAIR, "discovery")]
    return all(each["restartCount"] and each["ready"] for each in servers)


def _operator(story: Story) -> Manifest:
    """The operator's pod."""

    def running() -> list[Manifest]:
        items: list[Any] = story.kubectl.within(SYSTEM).json("get", "pods")["items"]
        return [
            pod
            for pod in items
            if "deletionTimestamp" not in pod["metadata"] and pod["status"].get("phase") == "Running"
        ]

    return eventually(running, "a pod of the operator")[0]


def _there(story: Story, kinds: str, name: str = "") -> list[str]:
    """The talker's objects of these kinds, or those of one name."""
    names = story.kubectl.names(kinds, "-l", f"app.kubernetes.io/instance={TALKER}")
    return [each for each in names if not name or each.endswith(f"/{name}")]


def _children(story: Story) -> int:
    """How many objects of the talker there are."""
    kinds = "secret,configmap,service,serviceaccount,role,rolebinding,lease,deployment,statefulset,networkpolicy"
    return len(_there(story, kinds))


def _agent_generation(story: Story) -> int:
    found: int = story.kubectl.json("get", "deployment", "talker-agent")["metadata"]["generation"]
    return found
