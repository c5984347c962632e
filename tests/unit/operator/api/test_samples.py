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


def test_the_navigation_stack_has_ten_nodes_and_core_ones_on_both_sides() -> None:
    nodes = load(ROOT / "manifests" / "samples" / "nav2.yaml").spec.nodes
    assert len(nodes) == 10
    assert {node.placement for node in nodes} == {"Robot", "Cloud", "Duplicated"}
    assert {node.placement for node in nodes if node.core} == {"Robot", "Duplicated"}


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.parent.name)
def test_an_example_runs_on_one_machine_and_lacks_only_images_for_a_cluster(file: Path) -> None:
    found = check(load(file).spec)
    assert {finding.reason for finding in found} <= {"NoImage", "NoInhibitService"}
