"""Every sample of manifests/samples is what it claims to be: something that one can apply as it is."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS
from robot_offload_lab.cluster.commands import Kubectl, documents
from tests.integration.resources import SAMPLES, talker

pytestmark = [pytest.mark.api, pytest.mark.core]

FILES = sorted(SAMPLES.glob("*.yaml"))
STRICT = ("--validate=strict", "--server-side")


def offloads(path: Path) -> list[dict[str, Any]]:
    return [each for each in yaml.safe_load_all(path.read_text()) if each["kind"] == "RobotOffload"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_api_server_stores_a_sample_as_the_models_read_it(kubectl: Kubectl, path: Path) -> None:
    kubectl("apply", *STRICT, "-f", str(path))
    stored = {each["metadata"]["name"]: each for each in kubectl.json("get", "robotoffloads")["items"]}
    assert sorted(stored) == sorted(each["metadata"]["name"] for each in offloads(path))
    for written in offloads(path):
        name = written["metadata"]["name"]
        # The same defaults on both sides: what the operator reads is what `robot-offload validate` has read.
        local = parse_object(written, str(path), rules=CLUSTER_CHECKS)
        assert parse_object(stored[name], name, unknown="ignore", rules=CLUSTER_CHECKS).spec == local.spec


def test_all_samples_fit_into_one_namespace(kubectl: Kubectl) -> None:
    answer = kubectl("apply", *STRICT, "--dry-run=server", "-f", str(SAMPLES), "-o", "name").split()
    assert sum(len(offloads(path)) for path in FILES) == sum(name.startswith("robotoffload.") for name in answer)
    assert len(answer) == len(set(answer))


@pytest.mark.parametrize("tool", ["--server-side=true", "--server-side=false"])
def test_applying_a_sample_again_changes_nothing(kubectl: Kubectl, tool: str) -> None:
    command = ("apply", "--validate=strict", tool, "-f", str(SAMPLES / "wheelchair.yaml"))
    kubectl(*command)
    before = kubectl.json("get", "robotoffloads")["items"]
    kubectl(*command)
    assert kubectl.json("get", "robotoffloads")["items"] == before


@pytest.mark.parametrize(
    ("where", "named"),
    [
        (("spec",), "spec.speed"),
        (("spec", "nodes", 0), "spec.nodes[0].speed"),
        (("spec", "nodes", 0, "run"), "spec.nodes[0].run.speed"),
        (("metadata",), "metadata.speed"),
    ],
)
def test_an_unknown_field_is_refused_and_named(kubectl: Kubectl, where: tuple[str | int, ...], named: str) -> None:
    wrong: Any = copy.deepcopy(talker())
    part = wrong
    for step in where:
        part = part[step]
    part["speed"] = 1
    refusal = kubectl.refuses("create", "--validate=strict", "-f", "-", stdin=documents(wrong))
    assert f'unknown field "{named}"' in refusal
    assert kubectl.names("robotoffloads") == []


def test_a_number_for_a_duration_is_refused_with_the_field(kubectl: Kubectl) -> None:
    wrong = talker()
    wrong["spec"]["switching"] = {"lossTimeout": 90}
    assert "spec.switching.lossTimeout" in kubectl.apply_refused(wrong)
