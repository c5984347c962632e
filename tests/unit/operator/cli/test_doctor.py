"""What `doctor` judges, from facts that were gathered elsewhere."""

from __future__ import annotations

import copy
import dataclasses
import datetime
from typing import Any

import pytest

from robot_offload.api.agent_state import parse_state
from robot_offload.api.crd import crd
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.cli.cluster import Live
from robot_offload.cli.doctor import checks as checkup
from robot_offload.cli.doctor import machine
from robot_offload.cli.doctor.checks import Finding
from robot_offload.cli.doctor.command import lines
from robot_offload.cli.doctor.machine import Machine
from robot_offload.insight.observed import observe
from tests.unit.operator.cli.resources import NOW, manifest, observed
from tests.unit.operator.reporter.states import text

GOOD = Machine(open_files=4096, realtime=20, receive_buffer=8 * 1024 * 1024, environment={})


def offload(**changes: Any) -> RobotOffload:
    values = manifest()
    values["spec"] |= changes
    return parse_object(values, "test", unknown="ignore", rules=())


def levels(findings: object) -> list[tuple[str, str]]:
    assert not isinstance(findings, str)
    return [(each.check, each.level) for each in findings]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("version", "level"),
    [
        ({"major": "1", "minor": "34", "gitVersion": "v1.34.4"}, "ok"),
        ({"major": "1", "minor": "29+", "gitVersion": "v1.29.1-eks"}, "ok"),
        ({"major": "1", "minor": "28", "gitVersion": "v1.28.0"}, "error"),
        ({"major": "2", "minor": "0", "gitVersion": "v2.0.0"}, "ok"),
        ({}, "unknown"),
    ],
)
def test_the_cluster_must_be_new_enough(version: dict[str, str], level: str) -> None:
    assert checkup.kubernetes_version(version).level == level


def test_the_definition_must_be_there_and_of_this_version() -> None:
    live = copy.deepcopy(crd())
    live["metadata"]["resourceVersion"] = "7"
    live["status"] = {"storedVersions": ["v1alpha1"]}
    assert checkup.definition(live, crd()).level == "ok"
    del live["spec"]["versions"][0]["schema"]["openAPIV3Schema"]["properties"]["spec"]
    assert checkup.definition(live, crd()).level == "warning"
    assert "helm install" in checkup.definition(None, crd()).step


def operator(ready: int = 1, namespace: str = "robot-offload") -> dict[str, Any]:
    return {"metadata": {"namespace": namespace, "name": "o"}, "status": {"readyReplicas": ready}}


def leader(renewed: str) -> dict[str, Any]:
    return {"metadata": {"namespace": "robot-offload", "name": "l"}, "spec": {"renewTime": renewed}}


@pytest.mark.parametrize(
    ("deployments", "leases", "found"),
    [
        ([], [], [("Operator", "error")]),
        ([operator(0)], [], [("Operator", "error")]),
        ([operator()], [], [("Operator", "ok")]),
        ([operator()], [leader("2026-11-21T10:09:50.000000Z")], [("Operator", "ok"), ("Leader", "ok")]),
        ([operator()], [leader("2026-11-21T09:00:00.000000Z")], [("Operator", "ok"), ("Leader", "error")]),
        ([operator()], [leader("2026-11-21T10:11:00.000000Z")], [("Operator", "ok"), ("Clocks", "warning")]),
        ([operator(), operator(1, "b")], [], [("Operator", "ok"), ("Operator", "ok"), ("Operator", "warning")]),
    ],
)
def test_one_living_operator_is_wanted(deployments: list[Any], leases: list[Any], found: list[Any]) -> None:
    assert levels(checkup.operator_alive(deployments, leases, NOW)) == found


@pytest.mark.parametrize(
    ("written", "level"),
    [
        ("2026-11-21T10:09:59.5Z", "ok"),
        ("2026-11-21T10:10:02Z", "ok"),
        ("2026-11-21T10:09:40Z", "error"),
        ("2026-11-21T10:10:20Z", "error"),
        ("never", "unknown"),
    ],
)
def test_clocks_that_differ_are_told(written: str, level: str) -> None:
    assert checkup.clocks(Live(parse_state(text(written=written))), NOW).level == level


def test_an_agent_that_cannot_be_asked_tells_no_time() -> None:
    finding = checkup.clocks(Live(problem="no endpoints"), NOW)
    assert (finding.level, "no endpoints" in finding.message) == ("unknown", True)


def test_addresses_that_are_pending_are_an_error_and_name_the_way_out() -> None:
    values = manifest()
    assert checkup.addresses(offload(), observe(values)).level == "ok"
    values["status"]["endpoints"] = []
    finding = checkup.addresses(offload(), observe(values))
    assert (finding.level, "NodePort" in finding.step) == ("error", True)


@pytest.mark.parametrize(
    ("image", "level"),
    [
        ("registry.example/node:1.2", "ok"),
        ("registry.example:5000/node:1", "ok"),
        ("registry.example/node@sha256:" + "00" * 32, "ok"),
        ("registry.example/node", "warning"),
        ("registry.example:5000/node", "warning"),
        ("registry.example/node:latest", "warning"),
    ],
)
def test_images_that_can_change_under_their_name_are_told(image: str, level: str) -> None:
    nodes = [dict(node, image=image) if node["placement"] != "Robot" else node for node in manifest()["spec"]["nodes"]]
    assert {finding.level for finding in checkup.images(offload(nodes=nodes))} == {level}


@pytest.mark.parametrize(("days", "level"), [(-1, "error"), (3, "warning"), (40, "ok"), (None, "unknown")])
def test_the_robots_certificate_must_last(days: int | None, level: str) -> None:
    end = None if days is None else NOW + datetime.timedelta(days=days, hours=1)
    finding = checkup.certificate(end, observed(), NOW)
    assert finding.level == level
    assert finding.level == "ok" or "kubectl offload bundle wheelchair-7 -n ward" in finding.step


def test_what_the_operator_has_found_is_told_in_short() -> None:
    broken = observed(WorkloadsAvailable=("False", "CrashLoop", "x"), Ready=("False", "CrashLoop", "x"))
    assert levels(checkup.conditions(broken)) == [("WorkloadsAvailable", "error")]
    assert levels(checkup.conditions(observed())) == [("Status", "ok")]
    assert levels(checkup.conditions(dataclasses.replace(observed(), generation=9))) == [("Status", "warning")]
    assert levels(checkup.conditions(dataclasses.replace(observed(), conditions=()))) == [("Status", "error")]


def test_a_good_machine_has_nothing_to_say() -> None:
    assert {finding.level for finding in machine.judge(GOOD, offload())} == {"ok"}


@pytest.mark.parametrize(
    ("change", "check"),
    [
        ({"open_files": 256}, "FileDescriptors"),
        ({"realtime": 0}, "RealtimePriority"),
        ({"receive_buffer": 212_992}, "ReceiveBuffer"),
        ({"busy_ports": tuple(range(17_910, 17_930, 2))}, "Ports"),
        ({"environment": {"ROS_DISTRO": "humble", "ROS_DOMAIN_ID": "42"}}, "RosEnvironment"),
        ({"environment": {"ROS_DISTRO": "jazzy"}}, "RosEnvironment"),
        (
            {"environment": {"ROS_DISTRO": "jazzy", "ROS_DOMAIN_ID": "42", "RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}},
            "RosEnvironment",
        ),
    ],
)
def test_each_thing_that_bites_on_a_machine_has_a_next_step(change: dict[str, Any], check: str) -> None:
    bad = [
        finding for finding in machine.judge(dataclasses.replace(GOOD, **change), offload()) if finding.level != "ok"
    ]
    assert [finding.check for finding in bad] == [check]
    assert bad[0].step


def test_a_shell_without_ros_is_no_robot_and_only_ros_settings_are_left_out() -> None:
    checks = [finding.check for finding in machine.judge(GOOD, offload())]
    assert checks == ["FileDescriptors", "RealtimePriority", "ReceiveBuffer", "Ports"]
    assert [finding.check for finding in machine.judge(GOOD, None)] == checks[:3]


def test_dds_across_the_network_cannot_stay_on_this_machine() -> None:
    environment = {"ROS_DISTRO": "jazzy", "ROS_DOMAIN_ID": "42", "ROS_LOCALHOST_ONLY": "1"}
    here = dataclasses.replace(GOOD, environment=environment)
    plain = offload(transport={"type": "DiscoveryServer"})
    assert [each.level for each in machine.judge(here, plain) if each.check == "RosEnvironment"] == ["error"]
    assert not [each for each in machine.judge(here, offload()) if each.check == "RosEnvironment"]


def test_this_machine_can_be_looked_at() -> None:
    here = machine.look(domain_id=42)
    assert here.open_files > 0
    assert len(here.busy_ports) <= 10


def test_a_port_that_nobody_serves_is_a_problem_in_words() -> None:
    assert machine.tcp_problem("127.0.0.1", 1, timeout_s=2.0)


def test_the_answer_ends_with_the_sum() -> None:
    shown = list(lines([Finding("A", "ok", "fine"), Finding("LongName", "error", "broken", "Mend it.")]))
    assert shown == [
        "ok      A         fine",
        "ERROR   LongName  broken",
        "                  Next: Mend it.",
        "1 errors, 0 warnings, 0 not known, 1 fine",
    ]
