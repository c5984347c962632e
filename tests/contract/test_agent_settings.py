"""Bundle, cloud configuration and settings, as rendered, against the agent that reads them."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from cryptography import x509

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Facts
from robot_offload.objects.parent import Parent
from robot_offload.render import handover
from robot_offload.render.agent_config import RUN_TIME, RUN_TIME_INPUT, SHARED
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload.render.pki import build_certificates
from robot_offload_agent.link.zenoh_config import ZenohSettings
from robot_offload_agent.main import main
from robot_offload_agent.settings import liaison, offer
from robot_offload_agent.settings import parameters as agent
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, facts, offload, rendered
from tests.unit.operator.render.test_rolls import RUN_TIME as CHANGES_AT_RUN_TIME

SECRETS = BundleSecrets(b"ca", b"certificate", b"key")
KNOWN = facts(endpoints=EVERY_ENDPOINT)


def configuration(text: str) -> agent.Configuration:
    return agent.parse(agent.flatten(yaml.safe_load(text)["/**"]["ros__parameters"]))


def robots(resource: RobotOffload, known: Facts = KNOWN) -> agent.Configuration:
    return configuration(bundle(Parent(resource, known), SECRETS)["agent.yaml"].decode())


def clouds(resource: RobotOffload, known: Facts = KNOWN) -> agent.Configuration:
    return configuration(rendered(resource, known)["ConfigMap/wheelchair-7-agent"]["data"]["agent.yaml"])


def judged(bundled: RobotOffload, now: RobotOffload) -> offer.Judgement:
    """What a robot with the bundle of one generation says to the settings of the next one."""
    settings = rendered(now, facts(generation=4))["ConfigMap/wheelchair-7-settings"]["data"]["settings.yaml"]
    return offer.judge(robots(bundled), 3, offer.read_offer(settings))


def test_both_packages_mean_the_same_by_run_time() -> None:
    assert set(offer.RUN_TIME) == RUN_TIME
    assert set(offer.RUN_TIME_INPUT) == RUN_TIME_INPUT


def test_only_what_an_agents_place_decides_is_left_out_of_the_settings() -> None:
    local = {
        "side", "uid", "robot_name", "runtime_dir", "state_dir", "realtime", "state_file", "settings_file",
        "handover_file", "certificate_file", "link", "black_box_mib",
    }  # fmt: skip
    top = {name.split(".")[0] for name in agent.GENERAL} | {prefix for prefix, _ in agent.GROUPS.values()}
    assert top - SHARED == local


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_both_agents_of_every_transport_start_with_what_is_rendered(transport: str) -> None:
    resource = offload(transport=TRANSPORTS[transport])
    robot, cloud = robots(resource), clouds(resource)
    assert (robot.side.value, cloud.side.value) == ("robot", "cloud")
    assert robot["uid"] == cloud["uid"] == KNOWN.uid
    assert robot["link.type"] == cloud["link.type"] == ("zenoh" if transport == "Zenoh" else "ros")
    assert robot["generation"] == cloud["generation"] == 3
    assert (robot["state_file"], cloud["state_file"]) == ("", "/run/robot-offload/state.json")


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_bundle_on_the_robots_disk_passes_the_agents_own_check(transport: str, tmp_path: Path) -> None:
    now = datetime.datetime.now(datetime.UTC)
    made = build_certificates(robot="wheelchair-7", host_names=["edge.example"], now=now)
    secrets = BundleSecrets(made.server_ca.certificate, made.robot.certificate, made.robot.private_key)
    resource = offload(transport=TRANSPORTS[transport])
    for path, content in bundle(Parent(resource, KNOWN), secrets, folder=str(tmp_path)).items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_bytes(content)
    assert main(["robot", "--params", str(tmp_path / "agent.yaml"), "--check"]) == 0


def test_the_endpoints_of_both_sides_are_ones_that_zenoh_takes() -> None:
    resource = offload()
    for found in (robots(resource), clouds(resource)):
        for session in ("pulse", "data"):
            ZenohSettings(
                side=found["side"],
                session=session,
                uid=found["uid"],
                endpoints=tuple(found[f"link.{session}_endpoints"]),
                fallback=tuple(found[f"link.{session}_fallback"]),
                ca="ca",
                certificate="c",
                private_key="k",
                peer_name=found["link.peer_name"],
            )


def test_settings_of_an_unchanged_resource_are_taken() -> None:
    assert judged(offload(), offload()).reason == "Accepted"


def test_a_stricter_setting_reaches_a_running_robot() -> None:
    found = judged(offload(), offload({"switching.pin": "Robot", "switching.lossTimeout": "70ms"}))
    assert found.reason == "Accepted"
    assert found.configuration is not None
    assert (found.configuration["pin"], found.configuration["loss_timeout_ms"]) == ("Robot", 70.0)
    assert found.configuration["generation"] == 4


@pytest.mark.parametrize(
    "path", [path for path in CHANGES_AT_RUN_TIME if path.split(".")[0] in ("switching", "topics")]
)
def test_no_change_at_run_time_needs_a_bundle(path: str) -> None:
    found = judged(offload(), offload({path: CHANGES_AT_RUN_TIME[path]}))
    assert found.reason in ("Accepted", "HardLimit"), found.message


NEEDS_BUNDLE: dict[str, Any] = {
    "switching.heartbeatPeriod": "25ms",
    "switching.strict": True,
    "driver": {"inhibitService": "/stop"},
    "nodes.1.core": False,
    "nodes.1.outputs": [{"topic": "/cmd_vel", "rate": 10}],
    "topics.toCloud.1.latched": True,
    "robot.namespace": "/chair",
}


@pytest.mark.parametrize("path", NEEDS_BUNDLE)
def test_what_only_a_new_bundle_brings_is_told(path: str) -> None:
    assert judged(offload(), offload({path: NEEDS_BUNDLE[path]})).reason == "NeedsBundle"


def test_a_robot_stays_away_from_pods_that_stop_until_they_are_killed_and_little_longer() -> None:
    assert handover.GRACE_S < liaison.LEAVING_S <= handover.GRACE_S + 10.0


def test_the_cloud_lets_in_the_robot_by_the_name_in_the_robots_certificate() -> None:
    resource = offload()
    made = build_certificates(
        robot=resource.metadata.name, host_names=["h"], now=datetime.datetime.now(datetime.UTC), days=1
    )
    for agents, certificate in ((clouds(resource), made.robot), (robots(resource), made.cloud)):
        subject = x509.load_pem_x509_certificate(certificate.certificate).subject
        assert [part.value for part in subject] == [agents["link.peer_name"]]
        assert agents["link.observers"] == ["none"]
