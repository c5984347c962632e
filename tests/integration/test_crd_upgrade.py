"""A newer CRD over objects that an older one has let in: they stay readable, get defaults, and can be repaired."""

from __future__ import annotations

import copy
import time
from collections.abc import Iterator
from typing import Any

import pytest

from robot_offload.api.crd import crd
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS
from robot_offload.errors import SpecError
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.errors import CommandError
from tests.integration.operator_cluster import PATIENCE_S
from tests.unit.specs import changed, sample

pytestmark = pytest.mark.api

NEWER_FIELDS = ("replicas", "scale", "driver")


def older_crd() -> dict[str, Any]:
    """Ours as it might have been: some fields are not there yet, and no rule between fields."""
    definition = copy.deepcopy(crd())
    version = definition["spec"]["versions"][0]
    del version["subresources"]["scale"]
    spec = version["schema"]["openAPIV3Schema"]["properties"]["spec"]
    for name in NEWER_FIELDS:
        del spec["properties"][name]
    without_rules(spec)
    return definition


def without_rules(part: dict[str, Any]) -> None:
    part.pop("x-kubernetes-validations", None)
    for field in part.get("properties", {}).values():
        without_rules(field)
    if "items" in part:
        without_rules(part["items"])


@pytest.fixture
def kubectl(bare_control_plane: ControlPlane) -> Iterator[Kubectl]:
    """A cluster in which the older CRD is installed."""
    kubectl = bare_control_plane.kubectl("default")
    install(kubectl, older_crd(), knows_the_driver=False)
    yield kubectl
    kubectl("delete", "crd", crd()["metadata"]["name"], "--wait")


def install(kubectl: Kubectl, definition: dict[str, Any], *, knows_the_driver: bool = True) -> None:
    """Applies a CRD and waits until the API server judges objects by it, which takes it a moment."""
    kubectl.apply(definition, options=("--server-side", "--force-conflicts"))
    probe = {**sample(), "metadata": {"name": "probe"}}
    deadline = time.monotonic() + PATIENCE_S
    answer = ""
    while time.monotonic() < deadline:
        try:
            answer = kubectl.apply(probe, options=("--server-side", "--dry-run=server", "--validate=strict"))
        except CommandError as error:
            answer = str(error)
            if not knows_the_driver and "spec.driver" in answer:
                return
        else:
            if knows_the_driver:
                return
        time.sleep(0.2)
    pytest.fail(f"The API server does not judge by the CRD after {PATIENCE_S:g} s: {answer}")


def older_object(path: str = "spec.replicas", value: Any = 1) -> dict[str, Any]:
    values = changed(path, value)
    for name in NEWER_FIELDS:
        values["spec"].pop(name, None)
    return values


def test_a_stored_object_gets_the_defaults_of_newer_fields(kubectl: Kubectl) -> None:
    kubectl.apply(older_object())
    assert "replicas" not in kubectl.json("get", "roff", "wheelchair-7")["spec"]
    install(kubectl, crd())
    stored = kubectl.json("get", "roff", "wheelchair-7")
    assert stored["spec"]["replicas"] == 1
    assert stored["spec"]["scale"] == {"idleTimeout": "10m"}
    assert parse_object(stored, "stored", unknown="ignore", rules=CLUSTER_CHECKS).spec.scale.idle_timeout_ms == 600_000


def test_a_stored_object_that_a_newer_rule_forbids_can_be_changed_elsewhere_and_repaired(kubectl: Kubectl) -> None:
    kubectl.apply(older_object("spec.switching.lossTimeout", "80ms"))
    install(kubectl, crd())
    stored = kubectl.json("get", "roff", "wheelchair-7")
    with pytest.raises(SpecError, match="is a multiple of the heartbeat period"):
        parse_object(stored, "stored", unknown="ignore", rules=CLUSTER_CHECKS)
    kubectl("scale", "roff", "wheelchair-7", "--replicas=0")
    kubectl("label", "roff", "wheelchair-7", "ward=3")
    patch = '{"spec": {"switching": {"lossTimeout": "%s"}}}'
    assert "is a multiple of the heartbeat period" in kubectl.refuses(
        "patch", "roff", "wheelchair-7", "--type=merge", "-p", patch % "100ms"
    )
    kubectl("patch", "roff", "wheelchair-7", "--type=merge", "-p", patch % "90ms")
    repaired = kubectl.json("get", "roff", "wheelchair-7")
    parse_object(repaired, "repaired", unknown="ignore", rules=CLUSTER_CHECKS)


def test_after_a_rollback_of_the_crd_an_object_is_still_read(kubectl: Kubectl) -> None:
    install(kubectl, crd())
    kubectl.apply(sample())
    install(kubectl, older_crd(), knows_the_driver=False)
    stored = kubectl.json("get", "roff", "wheelchair-7")
    assert "driver" not in stored["spec"]
    parse_object(stored, "stored", unknown="ignore", rules=CLUSTER_CHECKS)
