"""Both agents over two real DDS Routers 3.4.0 and the tunnel, where `DDSROUTER_BIN` names a router.

Without one the rendered files are checked against a model of the router's reader (tests/unit/operator/render).
"""

import datetime
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing

import pytest

from robot_offload.decide import renewal
from robot_offload.objects import pod
from robot_offload.render.pki import build_certificates
from robot_offload.transport import dds_router_xml, tunnel
from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.ears import wait_until
from tests.ros.agent.far_ear import FarEar
from tests.ros.agent.harness import World
from tests.ros.agent.namespaces import ip
from tests.ros.agent.routers import BINARY, ENVIRONMENT

pytestmark = pytest.mark.skipif(not BINARY, reason="DDSROUTER_BIN names no DDS Router")

STRANGER = """
import socket, sys, time
held = [socket.create_connection((sys.argv[1], 11666)) for _ in range(20)]
while True:
    socket.create_connection((sys.argv[1], 11666)).close()
    time.sleep(0.5)
"""


def back_after(world: World, heal: Callable[[], object]) -> float:
    """Seconds from a heal until the next message of the cloud's replica is heard."""
    since, at_s = len(world.arrivals), now_s()
    heal()
    world.until(lambda: any(one.site == "cloud" for one in world.arrivals[since:]), "the cloud's messages pass again")
    return next(one.t_s for one in world.arrivals[since:] if one.site == "cloud") - at_s


def reader(world: World, name: str, topic: str, durability: str) -> Callable[[], list[str]]:
    """Starts a reader in the cloud; returns what it has heard so far."""
    command = [sys.executable, "-m", "tests.ros.agent.reader", str(world.domain["cloud"]), topic, durability]
    world.processes.start(name, command, world.namespace("cloud"), ENVIRONMENT["cloud"])
    return lambda: world.processes.log(name).splitlines()


def test_the_cloud_acts_and_is_left_and_taken_again_by_command_and_by_a_cut(routed_world: World) -> None:
    routed_world.place("robot")
    routed_world.place("cloud")
    routed_world.cut("both")
    routed_world.goes_to("robot")
    wait_until(lambda: False, 4.0)
    back_after(routed_world, lambda: routed_world.cut(None))


def test_probes_and_strangers_at_the_door_do_not_disturb(routed_world: World) -> None:
    address = routed_world.routers.cloud_address
    routed_world.processes.start("stranger", [sys.executable, "-c", STRANGER, address], routed_world.namespace("robot"))
    since = len(routed_world.placed)
    for _ in range(4):  # the kubelet's, of router and tunnel
        for port in (dds_router_xml.LISTENING, tunnel.PORT.number):
            probe = pod.listens(port)["exec"]["command"]
            subprocess.run(["ip", "netns", "exec", routed_world.namespace("cloud"), *probe], check=True)
        wait_until(lambda: False, 1.0)
    assert [one.site for one in routed_world.placed[since:] if one.site != "cloud"] == []
    routed_world.routers.kill("robot-tunnel")
    routed_world.goes_to("robot")
    back_after(routed_world, lambda: routed_world.routers.run_part("robot", "tunnel"))


def test_whoever_publishes_in_the_cloud_is_not_heard_on_the_robot(routed_world: World) -> None:
    world = routed_world
    space = world.namespace("cloud")
    with closing(FarEar(world.processes, world.domain["cloud"], space, "/unused", ENVIRONMENT["cloud"])) as thief:
        assert thief.say("/odom", "cloud 1 1").success, "the thief is in the cloud's domain"
        assert not thief.say("/command", "cloud 1 1", 3.0).success, (
            "somebody in the cloud listens to what is meant for the robot"
        )
    assert {one.site for one in world.arrivals} <= {"robot", "cloud"}


def test_readers_of_both_kinds_hear_what_is_latched(routed_world: World) -> None:
    volatile = reader(routed_world, "volatile", "/map", "VOLATILE")
    wait_until(lambda: False, 2.0)
    latched = reader(routed_world, "latched", "/map", "TRANSIENT_LOCAL")
    routed_world.until(latched, "the kept message")
    assert volatile is not None


def test_a_robot_that_starts_without_a_link_or_gets_another_address_comes_in(build: Callable[..., World]) -> None:
    world = build(link="router")
    space = world.namespace("robot")
    ip("-n", space, "link", "set", "link0", "down")
    world.routers.kill("robot-router")  # on a robot that boots, everything starts without the interface
    world.routers.run_part("robot", "router")
    for side in ("cloud", "robot"):
        world.start_agent(side)
        world.start_node(side)
    world.goes_to("robot")
    ip("-n", space, "link", "set", "link0", "up")
    world.goes_to("cloud")
    ip("-n", space, "address", "del", "10.77.0.1/24", "dev", "link0")
    world.goes_to("robot")
    ip("-n", space, "address", "add", "10.77.0.9/24", "dev", "link0")
    ip("-n", space, "route", "replace", "224.0.0.0/4", "dev", "link0")
    world.goes_to("cloud")
    world.check()


def test_a_robot_renews_over_the_routers_and_its_tunnel_dials_with_what_came(build: Callable[..., World]) -> None:
    now = datetime.datetime.now(datetime.timezone.utc)
    earlier, made = (
        build_certificates(robot="walker-1", host_names=["127.0.0.1"], now=now - datetime.timedelta(days=age))
        for age in (1, 0)
    )
    world = build(link="router", files=True)
    assert world.certificates is not None
    world.write_bundle(made)
    files = world.certificates.robot
    world.routers.own = str(world.folder / "state/certificates/current")
    for side in ("cloud", "robot"):
        world.routers.restart(side, "tunnel")
        given = {"link__certificate": str(files.certificate), "link__private_key": str(files.private_key)}
        world.start_agent(side, **(given | {"robot_name": "walker-1"} if side == "robot" else {}))
        world.start_node(side)
    world.goes_to("cloud")
    world.until(lambda: world.state["certificate"]["request"], "the robot asks")
    bundled = int(world.state["certificate"]["serial"], 16)
    signer = renewal.Signer(made.client_ca, "walker-1", 30, bundled, None, {})
    world.answer(renewal.answer(world.state["certificate"]["request"], signer, now).text())
    world.until(lambda: int(world.state["certificate"]["serial"], 16) != bundled, "the robot has taken it")
    world.passes("cloud", 10)
    # A bundle whose authority the cloud does not know: what the agent has renewed is all that opens the tunnel.
    files.certificate.write_bytes(earlier.robot.certificate)
    files.private_key.write_bytes(earlier.robot.private_key)
    world.routers.kill("robot-tunnel")
    world.goes_to("robot")
    back_after(world, lambda: world.routers.run_part("robot", "tunnel"))
