"""The samples: each is right without a warning, says what it shows, and together they show every kind."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload.api.files import load
from robot_offload.api.v1alpha1.parsing import parse_text
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, check

ROOT = Path(__file__).parents[4]
SAMPLES = sorted((ROOT / "manifests" / "samples").glob("*.yaml"))
EXAMPLES = sorted((ROOT / "examples").glob("*/robotoffload.yaml"))


@pytest.mark.parametrize("file", SAMPLES, ids=lambda file: file.stem)
def test_a_sample_suits_a_cluster_without_a_warning_and_says_what_it_shows(file: Path) -> None:
    text = file.read_text()
    offload = parse_text(text, file.name, rules=CLUSTER_CHECKS)
    # A warning that the robot is not stopped by a service is no fault of a sample without a driver, and one that
    # nobody is kept out belongs to two of the transports.
    told = {finding.reason for finding in check(offload.spec, CLUSTER_CHECKS)}
    open_to_all = offload.spec.transport.type in ("DiscoveryServer", "StaticPeers")
    assert told - {"NoInhibitService"} == ({"NobodyIsKeptOut"} if open_to_all else set())
    assert offload.metadata.name == file.stem
    assert text.startswith("# ")
    assert max(map(len, text.splitlines())) <= 120


def test_the_samples_show_every_transport_every_exposure_and_every_standby() -> None:
    specs = [load(file).spec for file in SAMPLES]
    assert {spec.transport.type for spec in specs} == {"Zenoh", "DDSRouter", "DiscoveryServer", "StaticPeers"}
    assert {spec.transport.expose.type for spec in specs} == {"LoadBalancer", "NodePort", "ClusterIP"}
    assert any(spec.transport.expose.address for spec in specs)
    assert {node.standby.cloud for spec in specs for node in spec.nodes} >= {"Cold", "Warm"}
    assert any("nvidia.com/gpu" in node.resources.limits for spec in specs for node in spec.nodes)


def test_nav2s_nodes_are_those_of_its_bringup_and_what_guards_the_robot_stays_there() -> None:
    nodes = {node.name: node for node in load(ROOT / "manifests" / "samples" / "nav2.yaml").spec.nodes}
    assert {name for name, node in nodes.items() if node.duplicated} == {
        "amcl", "behavior_server", "bt_navigator", "controller_server", "planner_server", "smoother_server",
    }  # fmt: skip
    assert {"collision_monitor", "map_server", "velocity_smoother", "waypoint_follower"} <= {
        name for name, node in nodes.items() if node.placement == "Robot"
    }
    assert {node.placement for node in nodes.values() if node.core} == {"Robot", "Duplicated"}
    assert all(node.run and node.run.parameters_from for node in nodes.values() if node.duplicated)
    page = (ROOT / "docs" / "how-to" / "nav2.md").read_text()
    assert [name for name in nodes if f"`{name}`" not in page and name != "base_driver"] == []


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.parent.name)
def test_an_example_runs_on_one_machine_and_lacks_only_images_for_a_cluster(file: Path) -> None:
    found = check(load(file).spec)
    assert {finding.reason for finding in found} <= {"NoImage", "NoInhibitService"}
