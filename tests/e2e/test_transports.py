"""Case 2: each transport with real parts, between a real cluster and a robot outside it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from robot_offload.transport import DATA_PORT, PULSE_PORT
from tests.e2e.figures import figure
from tests.e2e.robot import Robot
from tests.e2e.story import READY, Story
from tests.e2e.transports_parts import (
    answering_on,
    answers_of,
    application,
    asked_in,
    asked_on,
    carry,
    in_charge,
    pod_of,
    said,
    to_the_cloud,
)
from tests.e2e.waiting import eventually

DELAY_MS: Final = 10.0
STARTED: Final = "DDS Router running."


@pytest.mark.core
def test_the_cloud_goes_on_over_tcp_while_a_firewall_blocks_udp(story: Story) -> None:
    offload = story.apply(application(story, "nat", {"type": "Zenoh"}))
    story.wait_conditions("nat", *READY)
    robot = story.robot(offload)
    to_the_cloud(robot, DELAY_MS, "Zenoh over QUIC")
    # Where QUIC took too long to begin, the sessions have begun over TCP and go back.
    eventually(lambda: _tcp_sessions(robot) == 0, "both sessions on QUIC", instead=lambda: _tcp_sessions(robot))
    robot.listen()

    blocked_s = time.monotonic()
    robot.host.block_udp(True)
    robot.until_site("robot")
    robot.until_site("cloud")
    heard = robot.heard("cloud")
    robot.until(lambda: robot.heard("cloud") > heard, "a message from the cloud over TCP")
    figure("UDP blocked to the cloud over TCP", time.monotonic() - blocked_s, "s")
    eventually(lambda: _tcp_sessions(robot) == 2, "pulse and data over TCP", instead=lambda: _tcp_sessions(robot))
    robot.begin()
    in_charge(robot, DELAY_MS, "Zenoh over TLS")

    open_s = time.monotonic()
    robot.host.block_udp(False)
    eventually(
        lambda: _tcp_sessions(robot) == 0, "both sessions back on QUIC", instead=lambda: robot.log("agent")[-500:]
    )
    figure("UDP open to both sessions over QUIC", time.monotonic() - open_s, "s")
    robot.listen()
    robot.until_site("cloud")
    robot.until(lambda: robot.heard("cloud") > 0, "a message from the cloud over QUIC")


def _tcp_sessions(robot: Robot) -> int:
    """How many connections the robot has to its cloud over TCP."""
    ports = f"( dport = :{PULSE_PORT} or dport = :{DATA_PORT} )"
    return len(robot.host.run("ss", "-Htn", "state", "established", ports).splitlines())


def test_nodes_on_both_sides_meet_through_the_discovery_servers_and_without_one_of_them(story: Story) -> None:
    name = "met"
    offload = story.apply(application(story, name, {"type": "DiscoveryServer"}))
    story.wait_conditions(name, *READY)
    robot = story.robot(offload, neighbour=True)
    to_the_cloud(robot, DELAY_MS, "DiscoveryServer")

    pod = pod_of(story, name, "answering")
    from_cloud = asked_on(robot, "cloud")
    assert said(from_cloud) == answers_of(name)
    figure("DiscoveryServer: new participant to the last of topic, service, action", _last_s(from_cloud), "s")
    with answering_on(robot, "robot"):
        assert said(asked_in(story, pod, "robot")) == answers_of("robot")

    with _gone(story, f"{name}-discovery-0-0"), answering_on(robot, "late"):
        assert said(asked_in(story, pod, "late")) == answers_of("late"), "two that come after the loss meet"
        assert said(asked_on(robot, "cloud")) == answers_of(name), "who comes after the loss meets who was there"


def test_nodes_on_both_sides_meet_at_a_listed_address(story: Story) -> None:
    name = "flat"
    host = story.host(name, neighbour=True)
    offload = story.apply(carry(application(story, name, {}), "StaticPeers", host.address))
    story.wait_conditions(name, *READY)
    robot = story.robot(offload, host=host)
    to_the_cloud(robot, DELAY_MS, "StaticPeers")

    assert said(asked_on(robot, "cloud")) == answers_of(name)
    with answering_on(robot, "robot"):
        assert said(asked_in(story, pod_of(story, name, "answering"), "robot")) == answers_of("robot")


def test_the_robots_tunnel_dials_the_address_that_the_cluster_gives(story: Story) -> None:
    name = "routed"
    offload = story.apply(application(story, name, {"type": "DDSRouter"}))
    story.bundle(name)  # waits until the load balancer has answered and the certificates are there
    address = story.kubectl.json("get", "service", f"{name}-router")["status"]["loadBalancer"]["ingress"][0]["ip"]
    config = eventually(lambda: _config(story, f"{name}-router"), "the router's configuration")
    assert {each["kind"] for each in config["participants"]} == {"local-discovery-server", "xml"}
    dialled = yaml.safe_load((story.folder / f"bundle-{name}" / "tunnel.yaml").read_text(encoding="utf-8"))["connect"]
    assert dialled == [f"{address}:{offload.spec.transport.dds_router.port}"]
    program = os.environ.get("DDSROUTER_BIN", "")
    if not program:
        pytest.skip("rendered, not run: DDSROUTER_BIN names no ddsrouter")
    robot = story.robot(offload)
    with _routed(robot, Path(program)) as text:
        eventually(lambda: STARTED in text(), "the robot's router to take its configuration", instead=text)


@contextmanager
def _routed(robot: Robot, program: Path) -> Iterator[Callable[[], str]]:
    """The DDS Router on the robot with the bundle's configuration; yields what it has written."""
    log = robot.folder / "router.log"
    child = robot.host.start([str(program), "-c", str(robot.place / "ddsrouter.yaml")], robot.environment(), log)
    try:
        yield lambda: log.read_text(encoding="utf-8", errors="replace")
    finally:
        child.terminate()
        child.wait()


def _config(story: Story, name: str) -> dict[str, Any]:
    """The router's configuration in the cluster; empty: not there yet."""
    if f"configmap/{name}" not in story.kubectl.names("configmaps"):
        return {}
    found: dict[str, Any] = yaml.safe_load(story.kubectl.json("get", "configmap", name)["data"]["router.yaml"])
    return found


@contextmanager
def _gone(story: Story, pod: str) -> Iterator[None]:
    """A pod is killed and comes back only at the end: no node takes it meanwhile."""
    kubectl = story.kubectl
    everywhere = kubectl.within("")
    everywhere("cordon", *story.cluster.nodes)
    try:
        kubectl("delete", "pod", pod, "--grace-period=0", "--force")
        eventually(lambda: _phase(story, pod) == "Pending", f"{pod} to be gone")
        yield
    finally:
        everywhere("uncordon", *story.cluster.nodes)
    kubectl("wait", "--for=condition=Ready", f"pod/{pod}", "--timeout=90s")


def _phase(story: Story, pod: str) -> str:
    found = [each for each in story.kubectl.json("get", "pods")["items"] if each["metadata"]["name"] == pod]
    return str(found[0]["status"]["phase"]) if found else ""


def _last_s(got: dict[str, dict[str, float]]) -> float:
    return max(each["after_s"] for each in got.values())
