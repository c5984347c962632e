"""The doctor on the robot: each thing that would bite is named, with the next step."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload_agent.doctor import graph, machine, network
from robot_offload_agent.doctor.findings import Check, Finding, Level, as_text
from robot_offload_agent.doctor.graph import Graph
from robot_offload_agent.doctor.machine import Machine
from robot_offload_agent.doctor.network import Endpoint
from robot_offload_agent.main import main
from robot_offload_agent.settings import parameters

PATIENCE_S = 60.0
GOOD = Machine(
    clock_error_s=0.001,
    open_files=65536,
    realtime=99,
    receive_buffer=8 << 20,
    environment={"ROS_DISTRO": "jazzy", "ROS_DOMAIN_ID": "7"},
)
GIVEN: dict[str, Any] = {
    "side": "robot",
    "uid": "walker-1",
    "domain_id": 7,
    "nodes": ["walker"],
    "outputs": ["command"],
    "output.command.topic": "/cmd_vel",
    "output.command.type": "geometry_msgs/msg/Twist",
    "output.command.robot_topic": "/offload/robot/cmd_vel",
    "output.command.cloud_topic": "/offload/cloud/cmd_vel",
}
DIALLING = {**GIVEN, "link.pulse_endpoints": ["quic/127.0.0.1:9"], "link.data_endpoints": ["quic/127.0.0.1:9"]}
CONFIGURATION = parameters.parse(GIVEN)
RUNNING = Graph(
    nodes=frozenset({"/walker"}), managers={"/walker": ("/guardian",)}, release="0.1.0", cloud_release="0.1.0"
)


def worst(findings: Iterator[Finding]) -> dict[str, Finding]:
    """What is not fine, by its check."""
    return {finding.check: finding for finding in findings if finding.level is not Level.OK}


def test_a_good_robot_has_no_findings() -> None:
    assert worst(machine.judge(GOOD, CONFIGURATION)) == {}
    assert worst(graph.judge(RUNNING, CONFIGURATION)) == {}


@pytest.mark.parametrize(
    ("different", "check", "word"),
    [
        ({"clock_error_s": None}, "Clock", "chrony"),
        ({"clock_error_s": 0.5}, "Clock", "chrony"),
        ({"open_files": 256}, "FileDescriptors", "LimitNOFILE"),
        ({"realtime": 0}, "RealtimePriority", "rtprio"),
        ({"receive_buffer": 212992}, "ReceiveBuffer", "sysctl"),
        ({"receive_buffer": None}, "ReceiveBuffer", ""),
        ({"environment": {"ROS_DISTRO": "jazzy"}}, "RosEnvironment", "environment"),
        ({"environment": {"ROS_DOMAIN_ID": "7"}}, "RosEnvironment", "Source"),
        ({"environment": {**GOOD.environment, "ROS_LOCALHOST_ONLY": "1"}}, "DdsDiscovery", "unset"),
    ],
)
def test_what_is_wrong_with_the_computer_is_named_with_the_next_step(
    different: dict[str, Any], check: str, word: str
) -> None:
    found = worst(machine.judge(replace(GOOD, **different), CONFIGURATION))
    assert set(found) == {check}
    assert word in found[check].step


@pytest.mark.parametrize(
    ("different", "check", "words"),
    [
        ({"publishers": {"/cmd_vel": ("/teleop",)}}, "SecondPublisher", ("/teleop", "/offload/robot/cmd_vel")),
        ({"managers": {"/walker": ("/lifecycle_manager",)}}, "SecondLifecycleManager", ("bond_timeout", "node_names")),
        ({"publishers": {"/bond": ("/walker",)}}, "Bonds", ("bond_timeout: 0.0",)),
        ({"server_timeout_ms": 20.0}, "ServerTimeout", ("default_server_timeout: 340",)),
        ({"nodes": frozenset()}, "Nodes", ("/walker", "ros2 node list")),
        ({"cloud_release": "0.2.0"}, "Releases", ("robot 0.1.0, cloud 0.2.0", "Install robot-offload-agent 0.2.0")),
        ({"cloud_release": ""}, "Releases", ("cloud's agent was not heard", "is connected")),
        ({"release": ""}, "Releases", ("no agent of this robot was heard",)),
        ({"problem": "No module named 'rclpy'"}, "RosGraph", ("Source ROS 2",)),
    ],
)
def test_what_is_wrong_in_the_graph_is_named_with_the_next_step(
    different: dict[str, Any], check: str, words: tuple[str, ...]
) -> None:
    found = worst(graph.judge(replace(RUNNING, **different), CONFIGURATION))
    assert set(found) == {check}
    assert all(word in found[check].message + found[check].step for word in words)


def test_what_is_in_flight_is_said_of_an_agent_that_runs() -> None:
    serving = parameters.parse(
        {
            **GIVEN, "actions": ["go"], "action.go.name": "/go", "action.go.type": "test_msgs/action/Fibonacci",
            "action.go.on_switch": "Resend", "action.go.node": "walker", "services": ["plan"],
            "service.plan.name": "/plan", "service.plan.type": "std_srvs/srv/Trigger", "service.plan.node": "walker",
            "states": ["pose"], "state.pose.node": "walker", "state.pose.kind": "Snapshot",
        }
    )  # fmt: skip
    counted = {"/go.running": 1, "/go.resent": 3, "/plan.open": 2, "state pose.age_at_change_ms": 80}
    findings = list(graph.judge(replace(RUNNING, counted=counted), serving))
    said = "/go 1 executing, 0 waiting, 3 restarts; /plan 2 open calls; state pose 80 ms old at the robot's last change"
    assert [finding.message for finding in findings if finding.check is Check.IN_FLIGHT] == [said]
    assert as_text(findings).splitlines()[-1] == f"InFlight: {said}"
    assert not [it for it in graph.judge(RUNNING, serving) if it.check is Check.IN_FLIGHT]


def test_the_agent_itself_is_no_second_publisher_and_no_second_manager() -> None:
    seen = replace(RUNNING, publishers={"/cmd_vel": ("/offload_collector",)}, managers={"/walker": ("/guardian",)})
    assert worst(graph.judge(seen, CONFIGURATION)) == {}


def test_each_missing_message_type_is_an_error_and_a_package_may_fail_in_any_way() -> None:
    def find(name: str) -> None:
        raise OSError(f"{name}: libfoo.so is missing")

    (found,) = graph.missing_types(CONFIGURATION, find)
    assert found.level is Level.ERROR
    assert "geometry_msgs/msg/Twist" in found.message


def test_one_way_to_the_cloud_is_enough_and_none_is_an_error() -> None:
    udp, tcp = Endpoint("quic", "edge", 7447), Endpoint("tls", "edge", 7447)
    assert [f.level for f in network.judge([(udp, "no answer"), (tcp, "")])] == [Level.WARNING, Level.OK]
    assert [f.level for f in network.judge([(udp, "no answer"), (tcp, "refused")])] == [Level.ERROR, Level.ERROR]
    assert [f.level for f in network.judge([(udp, ""), (tcp, "")])] == [Level.OK, Level.OK]


def test_a_robot_that_is_to_record_and_has_no_library_for_it_is_warned() -> None:
    recording = parameters.parse({**GIVEN, "record.switches": True})
    [found] = [each for each in machine.judge(replace(GOOD, records=False), recording) if each.check is Check.RECORDING]
    assert found.level is Level.WARNING
    assert "robot-offload-agent[record]" in found.step
    quiet = parameters.parse(GIVEN)
    assert Check.RECORDING not in [each.check for each in machine.judge(replace(GOOD, records=False), quiet)]


@contextmanager
def udp_server(answer: Callable[[bytes], bytes]) -> Iterator[int]:
    """Answers one datagram."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))

        def serve() -> None:
            heard, sender = opened.recvfrom(4096)
            opened.sendto(answer(heard), sender)

        thread = threading.Thread(target=serve)
        thread.start()
        yield opened.getsockname()[1]
        thread.join()


def test_a_quic_server_is_known_by_its_list_of_versions() -> None:
    asked = []

    def versions(heard: bytes) -> bytes:
        asked.append(heard)
        return bytes([0x80, 0, 0, 0, 0, 8]) + bytes(8) + bytes([8]) + bytes(8) + bytes.fromhex("00000001")

    with udp_server(versions) as port:
        assert network.reach(Endpoint("quic", "127.0.0.1", port), patience_s=PATIENCE_S) == ""
    assert len(asked[0]) >= 1200
    with udp_server(lambda _: b"hello") as port:
        assert "no QUIC" in network.reach(Endpoint("quic", "127.0.0.1", port), patience_s=PATIENCE_S)


def test_nobody_there_is_told_for_udp_tcp_and_unknown_names() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as opened:
        opened.bind(("127.0.0.1", 0))
        port = opened.getsockname()[1]
        assert "refused" in network.reach(Endpoint("tls", "127.0.0.1", port), patience_s=PATIENCE_S)
        assert network.reach(Endpoint("quic", "127.0.0.1", port), patience_s=0.3)
    assert "no.such.host.invalid" in network.reach(Endpoint("tls", "no.such.host.invalid", 1))


def test_something_that_speaks_no_tls_is_told() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.listen()

        def serve() -> None:
            accepted, _ = opened.accept()
            with accepted:
                accepted.recv(4096)
                accepted.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=serve)
        thread.start()
        assert network.reach(Endpoint("tls", "127.0.0.1", opened.getsockname()[1]), patience_s=PATIENCE_S)
        thread.join()


def test_endpoints_are_those_of_the_configuration_each_once() -> None:
    given = {**GIVEN, "link.pulse_endpoints": ["quic/edge.example:7447"], "link.data_endpoints": ["quic/[::1]:7448"],
             "link.pulse_fallback": ["tls/edge.example:7447"], "link.data_fallback": ["tls/[::1]:7448"]}  # fmt: skip
    found = [str(each) for each in network.endpoints(parameters.parse(given))]
    assert found == ["UDP edge.example:7447", "TCP edge.example:7447", "UDP ::1:7448", "TCP ::1:7448"]


def test_missing_certificates_are_an_error_with_the_way_to_new_ones(tmp_path: Path) -> None:
    given = {**DIALLING, "link.ca": str(tmp_path / "ca.pem")}
    (found,) = machine.certificates(parameters.parse(given))
    assert found.level is Level.ERROR
    assert "ca.pem" in found.message
    assert "kubectl offload bundle" in found.step


def test_people_see_errors_first_and_what_is_fine_in_one_line() -> None:
    lines = as_text([
        Finding(Check.NODES, Level.OK, ""), Finding(Check.CLOCK, Level.WARNING, "slow", "wind it up"),
        Finding(Check.MESSAGE_TYPES, Level.ERROR, "none"), Finding(Check.BONDS, Level.OK, ""),
    ]).splitlines()  # fmt: skip
    assert [line.split()[0] for line in lines] == ["error", "warning", "next:", "ok"]
    assert lines[-1].split(maxsplit=1)[1] == "Nodes, Bonds"


def test_the_file_of_the_cloud_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cloud.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"side": "cloud", "uid": "walker-1"}}}))
    assert main(["doctor", "--params", str(file)]) == 2
    assert "doctor looks at robots" in capsys.readouterr().err


def test_programs_read_json_and_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graph, "look", lambda _: Graph(problem="not asked in this test"))
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": DIALLING}}))
    assert main(["doctor", "--params", str(file), "--json", "--no-network"]) == 1  # it has no certificates
    found = json.loads(capsys.readouterr().out)
    assert {"Clock", "Certificates", "RosGraph", "Versions"} <= {one["check"] for one in found}
    assert all(set(one) == {"check", "level", "message", "step"} for one in found)


def test_a_link_without_an_address_is_a_bad_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": GIVEN}}))
    assert main(["doctor", "--params", str(file), "--no-network"]) == 2
    assert "quic/HOST:PORT" in capsys.readouterr().err
