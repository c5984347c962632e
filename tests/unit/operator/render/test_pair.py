"""Robot and workstation without Kubernetes: two folders that fit each other and nobody else."""

import datetime
import ipaddress
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from cryptography import x509

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.cli.own_images import default_images
from robot_offload.errors import InputError
from robot_offload.render.pair import Pair, Pairing, pair

ROOT = Path(__file__).resolve().parents[4]
NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
PAIRING = Pairing(uid="0001", host="192.168.1.10", images=default_images(), now=NOW, days=365)


def sample(name: str) -> RobotOffload:
    return load(ROOT / f"manifests/samples/{name}.yaml")


@pytest.fixture(scope="module")
def made() -> Pair:
    return pair(sample("wheelchair"), PAIRING)


def agent(files: dict[str, bytes]) -> dict[str, object]:
    found: dict[str, object] = yaml.safe_load(files["agent.yaml"])["/**"]["ros__parameters"]
    return found


def test_both_sides_have_one_identity_and_different_domains(made: Pair) -> None:
    robot, cloud = agent(dict(made.robot)), agent(dict(made.workstation))
    assert (robot["side"], cloud["side"]) == ("robot", "cloud")
    assert robot["uid"] == cloud["uid"] == "0001"
    assert robot["domain_id"] != cloud["domain_id"]
    assert f"ROS_DOMAIN_ID={cloud['domain_id']}" in made.workstation["environment"].decode()
    assert robot["runtime_dir"] != cloud["runtime_dir"]


def test_the_robot_dials_what_the_workstation_listens_on(made: Pair) -> None:
    robot, cloud = agent(dict(made.robot))["link"], agent(dict(made.workstation))["link"]
    assert isinstance(robot, dict)
    assert isinstance(cloud, dict)
    for session in ("pulse_endpoints", "data_endpoints", "pulse_fallback", "data_fallback"):
        assert robot[session] == [one.replace("0.0.0.0", "192.168.1.10") for one in cloud[session]]


def test_each_side_trusts_the_other_and_the_workstations_certificate_names_its_address(made: Pair) -> None:
    for own, name, other in ((made.robot, "robot", made.workstation), (made.workstation, "cloud", made.robot)):
        certificate = x509.load_pem_x509_certificate(own[f"certificates/{name}.pem"])
        certificate.verify_directly_issued_by(x509.load_pem_x509_certificate(other["certificates/ca.pem"]))
    names = x509.load_pem_x509_certificate(made.workstation["certificates/cloud.pem"]).extensions
    alternative = names.get_extension_for_class(x509.SubjectAlternativeName).value
    assert alternative.get_values_for_type(x509.IPAddress) == [ipaddress.ip_address("192.168.1.10")]


def test_the_workstation_starts_agent_and_replicas_by_compose_or_by_hand(made: Pair) -> None:
    services = yaml.safe_load(made.workstation["compose.yaml"])["services"]
    assert set(services) == {"agent", "node-controller"}
    assert "remote_controller" in str(services["node-controller"]["command"])
    readme = made.workstation["README.md"].decode()
    assert "remote_controller" in readme
    assert readme.index("## Install the agent") < readme.index("## Start it")
    unit = made.workstation["robot-offload-agent-cloud.service"].decode()
    assert "robot-offload-agent cloud --params" in unit
    assert "RuntimeDirectory=robot-offload/wheelchair-cloud" in unit


def test_the_robots_folder_is_a_bundle_whose_page_begins_with_the_install(made: Pair) -> None:
    readme = made.robot["README.md"].decode()
    assert readme.index("## Install the agent") < readme.index("## Start it")
    assert {"agent.yaml", "environment", "compose.yaml", "robot-offload-agent.service"} <= set(made.robot)


def test_a_transport_that_needs_a_cluster_is_refused_with_the_next_step() -> None:
    with pytest.raises(InputError, match="write Zenoh to pair"):
        pair(sample("dds-router"), PAIRING)


@pytest.mark.parametrize("domain", [0, 101])
def test_the_highest_domain_has_a_neighbour_too(domain: int) -> None:
    offload = sample("wheelchair")
    spec = offload.spec.model_copy(update={"robot": offload.spec.robot.model_copy(update={"domain_id": domain})})
    made = pair(offload.model_copy(update={"spec": spec}), replace(PAIRING, host="edge.example"))
    assert agent(dict(made.workstation))["domain_id"] in (domain - 1, domain + 1)


@pytest.mark.parametrize("host", ["::1", "2001:db8::7"])
def test_a_host_on_which_nothing_would_listen_is_refused(host: str) -> None:
    with pytest.raises(InputError, match="listens on IPv4; name an IPv4 address or a DNS name"):
        pair(sample("wheelchair"), replace(PAIRING, host=host))
