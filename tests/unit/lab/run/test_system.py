"""How a run is laid out on one machine: ports, domains, what is changed in the resource, which programs run where."""

import dataclasses
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from robot_offload.api.files import load
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload_lab.run import free
from robot_offload_lab.run.free import free_domains, free_ports
from robot_offload_lab.run.showcase import Showcase, Together
from robot_offload_lab.run.system import (
    HOST,
    Mode,
    NotRunnableError,
    System,
    adapted,
    check_runnable,
    environment,
    programs,
    run_info,
    wire_config,
)
from robot_offload_lab.wire.dds_options import DdsWireConfig, carried
from robot_offload_lab.wire.options import LinkOptions
from tests.unit.specs import changed

ROOT = Path(__file__).parents[4]
WHEELCHAIR = ROOT / "examples" / "wheelchair" / "robotoffload.yaml"


def system(tmp_path: Path, mode: Mode = Mode.OFFLOAD, transport: str = "") -> System:
    dialled, served = free_ports()
    return System(
        offload=adapted(load(WHEELCHAIR), mode, 7, transport),
        source=WHEELCHAIR.parent,
        mode=mode,
        run="a-run",
        out=tmp_path,
        temporary=tmp_path,
        domains=(221, 222),
        link=LinkOptions(delay="5ms", outages=("4/20",)),
        seed=7,
        realtime=False,
        dialled=dialled,
        served=served,
    )


def names(of: System) -> set[str]:
    return {program.name for program in programs(of)}


def test_both_sides_run_with_a_replica_each(tmp_path: Path) -> None:
    assert names(system(tmp_path)) == {
        "recorder",
        "robot-agent",
        "robot-wheelchair_base",
        "robot-passenger",
        "robot-localiser",
        "robot-controller",
        "cloud-agent",
        "cloud-remote_localiser",
        "cloud-remote_controller",
    }


def test_robot_only_has_no_cloud_side_and_is_pinned(tmp_path: Path) -> None:
    robot_only = system(tmp_path, Mode.ROBOT_ONLY)
    nodes = {f"robot-{name}" for name in ("wheelchair_base", "passenger", "localiser", "controller")}
    assert names(robot_only) == {"recorder", "robot-agent", *nodes}
    assert robot_only.spec.switching.pin == "Robot"
    assert not robot_only.wired


def test_cloud_only_has_no_replica_on_the_robot_and_is_pinned(tmp_path: Path) -> None:
    cloud_only = system(tmp_path, Mode.CLOUD_ONLY)
    assert "robot-controller" not in names(cloud_only)
    assert "cloud-remote_controller" in names(cloud_only)
    assert cloud_only.spec.switching.pin == "Cloud"


def test_the_seed_reaches_the_nodes_that_have_one(tmp_path: Path) -> None:
    commands = {program.name: program.command for program in programs(system(tmp_path))}
    assert "seed:=7" in commands["robot-wheelchair_base"]
    assert "seed:=7" not in commands["robot-controller"]


def test_robot_and_cloud_do_not_share_a_domain_or_the_callers_network_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "10.0.0.1:11811")
    robot, cloud = (environment(system(tmp_path), side) for side in ("robot", "cloud"))
    assert (robot["ROS_DOMAIN_ID"], cloud["ROS_DOMAIN_ID"]) == ("221", "222")
    assert robot["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_DISCOVERY_SERVER" not in robot


def test_the_robot_dials_the_wire_and_the_wire_dials_the_cloud(tmp_path: Path) -> None:
    one = system(tmp_path)
    ways = {(forward.protocol, forward.listen, forward.target) for forward in wire_config(one).forwards}
    for dialled, served in zip(one.dialled, one.served, strict=True):
        for protocol in ("udp", "tcp"):
            assert (protocol, f"{HOST}:{dialled}", f"{HOST}:{served}") in ways
    programs(one)
    assert f"quic/{HOST}:{one.dialled[0]}" in (tmp_path / "robot.yaml").read_text()
    assert f"quic/{HOST}:{one.served[0]}" in (tmp_path / "cloud.yaml").read_text()


def test_the_tunnel_of_two_routers_goes_through_the_wire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DDSROUTER_BIN", "/opt/ddsrouter")
    one = system(tmp_path, transport="DDSRouter")
    joining = {f"{side}-{part}" for side in ("robot", "cloud") for part in ("router", "tunnel")}
    assert names(one) & {*joining, "dds-wire"} == joining
    assert one.wired
    assert not one.joined_by_dds_wire  # so the demo starts the wire through which the tunnel goes
    [dialled] = yaml.safe_load((tmp_path / "robot-tunnel.yaml").read_text())["connect"]
    served = yaml.safe_load((tmp_path / "cloud-tunnel.yaml").read_text())["listen"]
    ways = {(forward.protocol, forward.listen, forward.target) for forward in wire_config(one).forwards}
    assert ("tcp", dialled, served) in ways


def test_without_a_router_the_emulated_link_for_topics_stands_in_for_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DDSROUTER_BIN", raising=False)
    one = system(tmp_path, transport="DDSRouter")
    assert one.joined_by_dds_wire
    assert "dds-wire" in names(one)


def test_only_declared_topics_cross_a_link_of_topics(tmp_path: Path) -> None:
    one = system(tmp_path, transport="StaticPeers")
    assert "dds-wire" in names(one)
    crossing = {(topic.topic, topic.direction) for topic in carried(one.spec)}
    assert {topic for topic, direction in crossing if direction == "down"} == {
        "/connectivity_test_remote",
        "/offload/link/cloud/probe",
        "/offload/link/cloud/report",
        "/offload/link/cloud/out_cmd_vel",
        "/offload/link/cloud/out_localiser__account",
        "/offload/link/cloud/state_localiser_1",
        "/offload/link/cloud/relay",
    }
    assert ("/scan", "up") in crossing
    assert ("/cmd_vel", "up") in crossing
    config = DdsWireConfig((221, 222), carried(one.spec), one.link, 7)
    assert DdsWireConfig.from_json(config.to_json()) == config


def test_free_ports_are_four_different_ones_that_can_be_bound() -> None:
    (a, b), (c, d) = free_ports()
    assert len({a, b, c, d}) == 4
    for port in (a, b, c, d):
        for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
            with socket.socket(socket.AF_INET, kind) as sock:
                sock.bind((HOST, port))


def test_runs_that_start_at_the_same_time_get_different_domains() -> None:
    code = """
import json, sys
from robot_offload_lab.run.free import free_domains
print(json.dumps(free_domains()), flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", code]
    runs = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    try:
        claimed = [domain for run in runs if run.stdout for domain in json.loads(run.stdout.readline())]
    finally:
        for run in runs:
            run.communicate()
    assert len(set(claimed)) == 6


@pytest.fixture
def no_claims(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What this process claims in a test is free after it: other tests start runs as well."""
    with monkeypatch.context() as patch:
        patch.setattr(free, "_claims", claims := {})
        yield
        for claim in claims.values():
            claim.close()


@pytest.mark.usefixtures("no_claims")
def test_one_process_can_lay_out_many_runs_one_after_the_other() -> None:
    for _ in range(30):
        robot, cloud = free_domains()
        assert robot != cloud


def test_a_parameter_file_of_a_cluster_cannot_be_used_on_one_machine() -> None:
    reference = {"configMapKeyRef": {"name": "parameters", "key": "nav2.yaml"}}
    offload = parse_object(changed("spec.nodes.1.run.parametersFrom", reference), "spec.yaml")
    with pytest.raises(NotRunnableError, match=r"nodes\[1\]\.run\.parametersFrom: .*use parameters"):
        check_runnable(offload, Path("spec.yaml"))


def shared(tmp_path: Path, mode: Mode = Mode.OFFLOAD) -> System:
    together = Together(name="stack", command=("python3", "stack.py"), nodes=("localiser", "controller", "passenger"))
    return dataclasses.replace(system(tmp_path, mode), said=Showcase(processes=(together,)))


def test_nodes_that_share_a_process_get_rules_of_their_own(tmp_path: Path) -> None:
    found = {program.name: program.command for program in programs(shared(tmp_path))}
    assert {"robot-stack", "cloud-stack"} <= set(found)
    assert not {"robot-localiser", "robot-passenger", "cloud-remote_controller"} & set(found)
    assert found["robot-stack"][1:6] == ("stack.py", "passenger", "localiser", "controller", "--ros-args")
    assert found["cloud-stack"][1:5] == ("stack.py", "localiser", "controller", "--ros-args")
    cloud = set(found["cloud-stack"])
    assert "controller:__node:=remote_controller" in cloud
    assert "remote_controller:/cmd_vel:=/offload/cloud/cmd_vel" in cloud
    assert "remote_controller:rate_hz:=50.0" in cloud
    assert "controller:rate_hz:=20.0" in found["robot-stack"]


def test_a_process_that_only_the_robot_needs_runs_there_alone(tmp_path: Path) -> None:
    found = {program.name: program.command for program in programs(shared(tmp_path, Mode.CLOUD_ONLY))}
    assert found["robot-stack"][1:4] == ("stack.py", "passenger", "--ros-args")


def test_a_node_that_shares_a_process_needs_no_run_and_a_stranger_in_it_is_named(tmp_path: Path) -> None:
    offload = load(WHEELCHAIR)
    bare = [node.model_copy(update={"run": None}) for node in offload.spec.nodes]
    offload = offload.model_copy(update={"spec": offload.spec.model_copy(update={"nodes": tuple(bare)})})
    names = [node.name for node in bare]
    together = Together(name="all", command=("all.py",), nodes=tuple(names))
    check_runnable(offload, tmp_path / "spec.yaml", Showcase(processes=(together,)))
    stranger = together.model_copy(update={"nodes": (*names, "stranger")})
    with pytest.raises(NotRunnableError, match=r"processes: 'stranger' is no node of spec\.yaml"):
        check_runnable(offload, tmp_path / "spec.yaml", Showcase(processes=(stranger,)))


def test_an_output_that_is_silent_while_nothing_is_done_is_not_waited_for(tmp_path: Path) -> None:
    assert system(tmp_path).awaited == ("/cmd_vel",)
    at_times = {"topic": "/cmd_vel", "rate": 20, "while": {"actions": ["/drive_to"]}}
    raw = yaml.safe_load(WHEELCHAIR.read_text())
    raw["spec"]["nodes"][3]["outputs"] = [at_times]
    one = dataclasses.replace(system(tmp_path), offload=parse_object(raw, "wheelchair.yaml"))
    assert one.awaited == ()
    assert run_info(one, 0.0).silent == ("/localiser/account", "/cmd_vel")
    assert run_info(one, 0.0).unrated == ("/localiser/account",)
