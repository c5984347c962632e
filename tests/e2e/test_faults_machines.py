"""Case 4, machines: a node, the API server or the robot itself fails; the robot moves to another network."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.e2e.chart import NAMESPACE as SYSTEM
from tests.e2e.faults import (
    WHEELCHAIR,
    arrived,
    away_and_back,
    births,
    delete_pod,
    drive,
    pod_of,
    until_cloud,
    wait_gone,
)
from tests.e2e.figures import figure
from tests.e2e.story import CONNECTED, READY, Story
from tests.e2e.waiting import eventually

NO_API_S = 120.0
"""Longer than any lease in the cluster, and than a kubelet's patience with its own status."""
AFTERWARDS_S = 20.0
"""Longer than an operator that begins anew needs to look at everything."""


@pytest.mark.core
def test_a_robot_bears_the_loss_of_a_cluster_node_and_its_return(story: Story) -> None:
    robot = drive(story)
    agent = pod_of(story, WHEELCHAIR, "agent")
    node = story.cluster.nodes[agent["spec"]["nodeName"]]

    off_s = time.monotonic()
    node.power_off()
    try:
        away_and_back(robot, patience_s=180.0)
        figure("node off to commands from another node", time.monotonic() - off_s, "s")
        assert pod_of(story, WHEELCHAIR, "agent")["spec"]["nodeName"] != node.name
    finally:
        on_s = time.monotonic()
        node.power_on()
        node.wait_ready()
    figure("node on to ready", time.monotonic() - on_s, "s")
    wait_gone(story, agent)
    _wait_cluster(story)
    story.wait_conditions(WHEELCHAIR, *CONNECTED)
    until_cloud(robot)

    arrived(robot)


def test_a_robot_that_keeps_sending_follows_the_agents_pod_to_another_node(story: Story) -> None:
    robot = drive(story)
    agent = pod_of(story, WHEELCHAIR, "agent")
    node = agent["spec"]["nodeName"]

    with _cordoned(story, node):
        delete_pod(story, agent)
        away_and_back(robot)
        assert pod_of(story, WHEELCHAIR, "agent")["spec"]["nodeName"] != node

    arrived(robot, asked=1)


def test_a_robot_drives_on_in_the_cloud_without_the_api_server(story: Story) -> None:
    robot = drive(story)
    before = births(story)

    with story.cluster.without_api():
        robot.rest(NO_API_S)
        until_cloud(robot)
    robot.rest(AFTERWARDS_S)
    story.wait_conditions(WHEELCHAIR, *CONNECTED)

    assert births(story) == before, "pods were rolled although nothing had changed"
    until_cloud(robot)
    arrived(robot)


def test_a_robot_that_is_switched_on_without_a_cluster_drives_by_itself(story: Story) -> None:
    robot = drive(story)
    robot.finish()
    robot.power_off()
    robot.host.wire.set(cut="both")

    robot.listen()
    robot.begin()
    robot.start_nodes()
    on_s = robot.start_agent()
    robot.until(lambda: robot.heard("robot") > 0, "a command of the robot's own")
    robot.rest(5.0)
    assert robot.heard("cloud") == 0
    robot.host.wire.set(cut=None)
    until_cloud(robot)
    robot.rest(3.0)

    measures = arrived(robot)
    first = next(each for each in measures.recording.outputs["/cmd_vel"])
    figure("robot switched on to its first command, no cluster", first.t_s - on_s, "s")


def test_a_robot_that_gets_another_address_goes_on_in_the_cloud_from_there(story: Story) -> None:
    robot = drive(story)

    before = robot.host.address
    assert robot.host.change_address() != before
    robot.rest(10.0)  # QUIC follows the address: the robot need not even take over
    until_cloud(robot)

    arrived(robot)


@contextmanager
def _cordoned(story: Story, node: str) -> Iterator[None]:
    """Nothing new is placed on a node within the block, as while it is drained."""
    kubectl = story.kubectl.within("")
    kubectl("cordon", node)
    try:
        yield
    finally:
        kubectl("uncordon", node)


def _wait_cluster(story: Story) -> None:
    """Waits until the cluster's own pods, and our operator, are what they were; the next story needs them."""
    _wait_available(story, "kube-system", "coredns")
    _wait_available(story, SYSTEM, "robot-offload-operator")
    story.wait_conditions(WHEELCHAIR, *READY)


def _wait_available(story: Story, namespace: str, deployment: str) -> None:
    def available() -> bool:
        found = story.kubectl.within(namespace).json("get", "deployment", deployment)
        wanted: int = found["spec"]["replicas"]
        return bool(found["status"].get("availableReplicas") == wanted)

    eventually(available, f"{deployment} to be available")
