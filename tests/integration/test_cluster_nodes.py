"""Both kinds of test cluster with nodes: what the end-to-end tests rely on. One of each for all of them."""

from __future__ import annotations

import json
import math
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robot_offload_lab.cluster import kind_cluster, oci
from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.cluster import Cluster
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.errors import ClusterError, CommandError, NotHereError
from robot_offload_lab.cluster.kind_cluster import KindCluster
from robot_offload_lab.cluster.preflight import preflight
from robot_offload_lab.cluster.robot_host import NatRobot, RobotHost
from robot_offload_lab.cluster.system_images import OURS, TESTER
from tests.integration.cluster_objects import PORT, echo_pod, echo_service, policy

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(900)]
TOLD_S = 180.0
"""For what a kubelet has to report."""


@pytest.fixture(scope="module", params=["own", "kind"])
def cluster(request: pytest.FixtureRequest) -> Iterator[AnyCluster]:
    missing, kind = (preflight, Cluster) if request.param == "own" else (kind_cluster.missing, KindCluster)
    if why := missing():
        pytest.skip(why)
    running = kind.up(say=lambda line: sys.stderr.write(f"{line}\n"))
    try:
        yield running
    finally:
        left = running.down()
    assert not left


@pytest.fixture(scope="module")
def first(cluster: AnyCluster) -> str:
    """The node of the pods that are called near."""
    return sorted(cluster.nodes)[0]


@pytest.fixture(scope="module")
def second(cluster: AnyCluster) -> str:
    """The node of the pods that are called far."""
    return sorted(cluster.nodes)[1]


@pytest.fixture(scope="module")
def echo(cluster: AnyCluster, first: str, second: str) -> Kubectl:
    """A namespace with one echo pod on each node and the Service of both."""
    kubectl = namespace(cluster, "echo")
    kubectl.apply(echo_pod("near", first), echo_pod("far", second), echo_service(type="LoadBalancer"))
    kubectl("wait", "--for=condition=Ready", "pods", "--all", "--timeout=120s")
    return kubectl


@pytest.fixture
def robot(cluster: AnyCluster) -> Iterator[NatRobot]:
    host = cluster.robot("robot")
    assert isinstance(host, NatRobot)
    yield host
    host.remove()


@pytest.fixture
def neighbour(cluster: AnyCluster) -> Iterator[RobotHost]:
    host = cluster.neighbour("neighbour")
    yield host
    host.remove()


def namespace(cluster: AnyCluster, word: str) -> Kubectl:
    return cluster.kubectl(cluster.plane.new_namespace(f"{word}-{secrets.token_hex(3)}"))


def soon(question: Callable[[], bool], seconds: float = 60) -> bool:
    """Whether something becomes true; the time is generous because the machine may be busy."""
    deadline = time.monotonic() + seconds
    while not question():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def pod_asks(kubectl: Kubectl, pod: str, *question: str) -> str:
    """What the tester prints in a pod; nothing when it gets no answer."""
    try:
        return kubectl("exec", pod, "--", "/tester", *question).strip()
    except CommandError:
        return ""


def host_asks(cluster: AnyCluster, host: RobotHost, protocol: str, address: str) -> str:
    """What the tester prints on a machine outside; nothing when it gets no answer."""
    try:
        return host.run(str(cluster.tester), "ask", protocol, f"{address}:{PORT}").strip()
    except ClusterError:
        return ""


def reaches(ask: Callable[..., str], *question: Any) -> bool:
    """Whether an answer comes: the tester waits two seconds for one, and a busy machine may take longer."""
    return soon(lambda: ask(*question) != "")


def balancer(kubectl: Kubectl, service: str = "echo") -> str:
    """The load balancer address of a Service."""
    given: list[dict[str, str]] = []

    def has_one() -> bool:
        status = kubectl.json("get", "service", service)["status"]
        given.extend(status["loadBalancer"].get("ingress", []))
        return bool(given)

    assert soon(has_one), f"{service} gets no address"
    return given[0]["ip"]


def pod_address(kubectl: Kubectl, pod: str) -> str:
    return str(kubectl.json("get", "pod", pod)["status"]["podIP"])


@pytest.mark.parametrize("pod", ["near", "far"])
def test_a_pod_on_each_node_learns_the_address_of_a_service(echo: Kubectl, pod: str) -> None:
    address = echo.json("get", "service", "echo")["spec"]["clusterIP"]
    assert soon(lambda: pod_asks(echo, pod, "lookup", "echo") == address)
    assert soon(lambda: pod_asks(echo, pod, "lookup", f"echo.{echo.namespace}.svc.cluster.local") == address)


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_a_service_is_answered_by_the_pods_of_both_nodes(echo: Kubectl, protocol: str) -> None:
    answering: set[str] = set()

    def both() -> bool:
        answering.add(pod_asks(echo, "near", "ask", protocol, f"echo:{PORT}").split(" ")[0])
        return {"near", "far"} <= answering

    assert soon(both), answering


def test_pods_of_two_nodes_see_each_others_own_address(echo: Kubectl) -> None:
    near, far = (pod_address(echo, pod) for pod in ("near", "far"))
    answers: list[str] = []

    def answered() -> bool:
        answers.append(pod_asks(echo, "near", "ask", "udp", f"{far}:{PORT}"))
        return answers[-1] != ""

    assert soon(answered)
    assert answers[-1] == f"far {near}"


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_a_robot_behind_nat_reaches_a_load_balancer_address(
    cluster: AnyCluster, echo: Kubectl, robot: NatRobot, protocol: str
) -> None:
    assert reaches(host_asks, cluster, robot, protocol, balancer(echo))


def test_a_service_with_the_local_policy_sees_the_robots_gateway(
    cluster: AnyCluster, echo: Kubectl, robot: NatRobot
) -> None:
    echo.apply(echo_service("local", type="LoadBalancer", externalTrafficPolicy="Local"))
    answers: list[str] = []

    def answered() -> bool:
        answers.append(host_asks(cluster, robot, "udp", balancer(echo, "local")))
        return answers[-1] != ""

    assert soon(answered)
    assert answers[-1].split(" ")[1] == robot.outer_address


def test_nobody_in_the_cluster_reaches_a_robot(
    cluster: AnyCluster, echo: Kubectl, robot: NatRobot, neighbour: RobotHost
) -> None:
    with robot.start([str(cluster.tester), "serve", str(PORT)]) as server:
        assert reaches(host_asks, cluster, robot, "tcp", "127.0.0.1")  # it does serve
        for address in (robot.address, robot.outer_address):
            assert pod_asks(echo, "near", "ask", "tcp", f"{address}:{PORT}") == ""
            assert host_asks(cluster, neighbour, "udp", address) == ""
        server.kill()


def test_a_robot_reaches_no_pod_but_a_neighbour_does_and_is_reached(
    cluster: AnyCluster, echo: Kubectl, robot: NatRobot, neighbour: RobotHost
) -> None:
    pod = pod_address(echo, "far")
    assert host_asks(cluster, robot, "tcp", pod) == ""
    assert soon(lambda: host_asks(cluster, neighbour, "tcp", pod) == f"far {neighbour.address}")
    with neighbour.start([str(cluster.tester), "serve", str(PORT)]) as server:
        assert reaches(pod_asks, echo, "near", "ask", "udp", f"{neighbour.address}:{PORT}")
        server.kill()


def test_blocked_udp_leaves_tcp(cluster: AnyCluster, echo: Kubectl, robot: NatRobot) -> None:
    assert reaches(host_asks, cluster, robot, "udp", balancer(echo))
    robot.block_udp(True)
    assert host_asks(cluster, robot, "udp", balancer(echo)) == ""
    assert reaches(host_asks, cluster, robot, "tcp", balancer(echo))
    robot.block_udp(False)
    assert reaches(host_asks, cluster, robot, "udp", balancer(echo))


def test_a_link_that_is_cut_one_way_still_carries_the_other(
    cluster: AnyCluster, echo: Kubectl, neighbour: RobotHost
) -> None:
    def frames(way: str) -> int:
        return int(neighbour.wire.state()["frames"][way][0])

    pod = pod_address(echo, "far")
    assert reaches(host_asks, cluster, neighbour, "udp", pod)
    neighbour.wire.set(cut="to_robot")
    sent, received = frames("to_cloud"), frames("to_robot")
    assert host_asks(cluster, neighbour, "udp", pod) == ""
    assert (frames("to_cloud") > sent, frames("to_robot") == received) == (True, True)
    neighbour.wire.set(cut="to_cloud")
    sent = frames("to_cloud")
    assert host_asks(cluster, neighbour, "udp", pod) == ""
    assert frames("to_cloud") == sent
    neighbour.wire.set(cut=None)
    assert reaches(host_asks, cluster, neighbour, "udp", pod)


def test_a_delay_and_a_recording_are_felt_both_ways(
    cluster: AnyCluster, echo: Kubectl, neighbour: RobotHost, tmp_path: Path
) -> None:
    def fastest_us() -> float:
        answer = neighbour.run(str(cluster.tester), "measure", f"{pod_address(echo, 'far')}:{PORT}", "5", "10")
        found = json.loads(answer)
        return float(found["min"]) if found["answers"] else math.inf

    neighbour.wire.set(delay_ms=30)
    assert fastest_us() >= 60_000
    neighbour.wire.set(delay_ms=0)
    assert soon(lambda: fastest_us() < 60_000)  # the first five may come while the machine is busy
    trace = tmp_path / "trace.txt"
    trace.write_text("80\n" * 10_000)
    assert neighbour.wire.play(trace) == pytest.approx(800)
    assert fastest_us() >= 80_000
    neighbour.wire.set()
    assert soon(lambda: fastest_us() < 80_000)


def test_a_robot_that_moves_has_another_address_and_reaches_the_same_things(
    cluster: AnyCluster, echo: Kubectl, robot: NatRobot
) -> None:
    before = (robot.address, robot.outer_address)
    robot.change_address()
    assert robot.address != before[0]
    assert robot.outer_address != before[1]
    assert reaches(host_asks, cluster, robot, "udp", balancer(echo))


def test_a_robot_without_power_runs_nothing_and_keeps_its_files(robot: NatRobot) -> None:
    with robot.start(["sh", "-c", "echo kept > /var/lib/robot; exec sleep 1000"]) as sleeper:
        assert soon(lambda: Path(f"/proc/{sleeper.pid}/root/var/lib/robot").exists())
        robot.power_off()
        assert sleeper.wait(60) < 0
    with robot.start(["cat", "/var/lib/robot"], piped=True) as after:
        assert after.communicate()[0] == b"kept\n"


def test_a_network_policy_holds_on_the_same_node_and_across_nodes_until_it_is_switched_off(
    cluster: AnyCluster, echo: Kubectl, first: str, second: str
) -> None:
    kubectl = namespace(cluster, "policy")
    kubectl.apply(
        echo_pod("server", first, app="server"),
        echo_pod("friend", first, app="friend"),
        echo_pod("stranger", first, app="stranger"),
        echo_pod("remote", second, app="stranger"),
    )
    kubectl("wait", "--for=condition=Ready", "pods", "--all", "--timeout=120s")
    server = f"{pod_address(kubectl, 'server')}:{PORT}"
    friends = [{"podSelector": {"matchLabels": {"app": "friend"}}}]
    rule = {"from": friends, "ports": [{"protocol": "UDP", "port": PORT - 10, "endPort": PORT + 10}]}
    kubectl.apply(policy("only-friends", "server", ingress=[rule]))

    assert soon(lambda: pod_asks(kubectl, "stranger", "ask", "udp", server) == "")
    assert pod_asks(kubectl, "remote", "ask", "udp", server) == ""
    assert reaches(pod_asks, kubectl, "friend", "ask", "udp", server)
    assert pod_asks(kubectl, "friend", "ask", "tcp", server) == ""  # not declared
    assert pod_asks(echo, "near", "ask", "udp", server) == ""  # another namespace

    try:
        cluster.enforce_policies(False)
    except NotHereError as why:
        pytest.skip(f"it holds; but not switched off: {why}")
    assert reaches(pod_asks, kubectl, "stranger", "ask", "udp", server)
    assert reaches(pod_asks, kubectl, "remote", "ask", "udp", server)
    cluster.enforce_policies(True)
    assert pod_asks(kubectl, "stranger", "ask", "udp", server) == ""


def test_a_pod_that_may_send_nowhere_but_to_names_gets_names_only(
    cluster: AnyCluster, echo: Kubectl, second: str
) -> None:
    kubectl = namespace(cluster, "egress")
    kubectl.apply(echo_pod("quiet", second, app="quiet"))
    kubectl("wait", "--for=condition=Ready", "pods", "--all", "--timeout=120s")
    service = f"echo.{echo.namespace}.svc.cluster.local"
    assert reaches(pod_asks, kubectl, "quiet", "ask", "tcp", f"{service}:{PORT}")
    names = {"ports": [{"protocol": each, "port": 53} for each in ("UDP", "TCP")]}
    kubectl.apply(policy("quiet", "quiet", policyTypes=["Ingress", "Egress"], egress=[names]))
    assert soon(lambda: pod_asks(kubectl, "quiet", "ask", "tcp", f"{service}:{PORT}") == "")
    assert reaches(pod_asks, kubectl, "quiet", "lookup", service)
    # The kubelet's own probes pass: the pod stays ready.
    assert "True" in kubectl("get", "pod", "quiet", "-o", "jsonpath={.status.conditions[?(@.type=='Ready')].status}")


def test_without_the_api_server_everything_runs_on(cluster: AnyCluster, echo: Kubectl, robot: NatRobot) -> None:
    address = balancer(echo)
    assert reaches(host_asks, cluster, robot, "tcp", address)
    with cluster.without_api():
        assert "refused" in echo.refuses("get", "pods")
        assert reaches(host_asks, cluster, robot, "tcp", address)
    assert "near" in echo("get", "pods")


def test_a_node_cut_off_the_network_runs_on_and_is_reached_by_nobody(
    cluster: AnyCluster, echo: Kubectl, neighbour: RobotHost, second: str
) -> None:
    node = cluster.nodes[second]
    pod = pod_address(echo, "far")
    assert reaches(host_asks, cluster, neighbour, "udp", pod)
    node.partition()
    assert host_asks(cluster, neighbour, "udp", pod) == ""
    node.heal()
    assert soon(lambda: host_asks(cluster, neighbour, "udp", pod).startswith("far "))
    node.wait_ready()


def test_an_image_goes_once_its_archive_is_gone(cluster: AnyCluster, tmp_path: Path) -> None:
    if not isinstance(cluster, Cluster):
        pytest.skip("its images go with its nodes")

    def there() -> set[str]:
        images = cluster.kubectl().json("get", "node", "node1")["status"]["images"]
        return {name for image in images for name in image.get("names") or []}

    # A kubelet lists its images every 30 s and reports them with its status, some 10 s later.
    old, new = f"{OURS}old:1", f"{OURS}new:1"
    program = tmp_path / "program"
    for word, name in (("old", old), ("new", new)):
        program.write_text(word)
        oci.write(tmp_path / f"{word}.tar", name, program)
    cluster.import_images(tmp_path / "old.tar")
    assert soon(lambda: old in there(), TOLD_S)
    (tmp_path / "old.tar").unlink()
    cluster.import_images(tmp_path / "new.tar")
    assert soon(lambda: old not in there() and new in there(), TOLD_S)
    assert TESTER in there()


def test_the_programs_of_a_node_are_those_that_were_pinned(cluster: AnyCluster) -> None:
    if not isinstance(cluster, Cluster):
        pytest.skip("its image says which they are")
    versions = {
        each["status"]["nodeInfo"]["kubeletVersion"] for each in cluster.kubectl().json("get", "nodes")["items"]
    }
    assert versions == {"v1.34.4"}
    assert all(re.fullmatch(r"node\d", name) for name in cluster.nodes)


def test_a_power_cut_is_noticed_and_the_other_node_takes_over(
    cluster: AnyCluster, echo: Kubectl, robot: NatRobot, first: str, second: str
) -> None:
    node, other = cluster.nodes[first], cluster.nodes[second]
    address = balancer(echo)
    node.power_off()
    assert soon(lambda: not node.is_ready())
    assert soon(other.is_ready)
    assert soon(lambda: host_asks(cluster, robot, "tcp", address).startswith("far "))
    node.power_on()
    node.wait_ready()
    # What ran there may have been evicted meanwhile; something new runs there as before.
    echo.apply(echo_pod("again", first))
    echo("wait", "--for=condition=Ready", "pod/again", "--timeout=120s")
    assert reaches(pod_asks, echo, "again", "lookup", "echo")
