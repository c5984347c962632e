"""The life of a release on a real API server: install, upgrade, roll back, uninstall."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.definitions import definitions
from robot_offload_lab.cluster.pretended_kubelet import report_ready
from tests.integration.chart import CHART, OPERATOR, RELEASE, with_values
from tests.integration.operator_cluster import eventually
from tests.integration.resources import talker

pytestmark = pytest.mark.api

DEFINITION = yaml.safe_load(definitions()[0].read_text())
EVERYTHING = (
    "deployments,replicasets,pods,services,serviceaccounts,roles,rolebindings,networkpolicies,secrets,configmaps"
)


@pytest.fixture
def kubectl(bare_control_plane: ControlPlane) -> Iterator[Kubectl]:
    """Kubectl in a restricted namespace of a cluster that has never seen the chart."""
    bound = bare_control_plane.kubectl(f"system-{secrets.token_hex(3)}")
    bare_control_plane.new_namespace(bound.namespace, pod_security="restricted")
    yield bound
    bound("delete", "customresourcedefinition", DEFINITION["metadata"]["name"], "--ignore-not-found", "--timeout=110s")
    ours = "clusterroles,clusterrolebindings,validatingadmissionpolicies,validatingadmissionpolicybindings"
    bound("delete", ours, "-l", f"app.kubernetes.io/name={OPERATOR}")
    bound("delete", "namespace", bound.namespace, "--ignore-not-found", "--wait=false")


@pytest.fixture
def helm(bare_control_plane: ControlPlane, kubectl: Kubectl) -> Helm:
    return bare_control_plane.helm(kubectl.namespace)


def memory_limit(kubectl: Kubectl) -> str:
    (container,) = kubectl.json("get", "deployment", OPERATOR)["spec"]["template"]["spec"]["containers"]
    return str(container["resources"]["limits"]["memory"])


def with_older_definition(chart: Path, forgotten: str) -> Path:
    """A copy of the chart from before a field of the spec existed."""
    shutil.copytree(CHART, chart)
    path = chart / "files" / "crd.yaml"
    definition = yaml.safe_load(path.read_text())
    for version in definition["spec"]["versions"]:
        spec = version["schema"]["openAPIV3Schema"]["properties"]["spec"]
        del spec["properties"][forgotten]
        spec["x-kubernetes-validations"] = [
            rule for rule in spec.get("x-kubernetes-validations", []) if forgotten not in rule["rule"]
        ]
    path.write_text(yaml.safe_dump(definition))
    return chart


def test_a_restricted_namespace_takes_the_operators_pod(
    bare_control_plane: ControlPlane, helm: Helm, kubectl: Kubectl
) -> None:
    notes = helm("install", RELEASE, str(CHART))
    assert f"rollout status deployment/{OPERATOR}" in notes
    kubectl("wait", "--for=create", "pods", "-l", f"app.kubernetes.io/name={OPERATOR}", "--timeout=110s")
    report_ready(bare_control_plane, kubectl.namespace)
    kubectl("rollout", "status", f"deployment/{OPERATOR}", "--timeout=110s")


def test_an_upgrade_changes_and_a_rollback_restores(helm: Helm, kubectl: Kubectl) -> None:
    without = {"crds.install": False}
    helm("install", RELEASE, str(CHART), *with_values(without))
    before = memory_limit(kubectl)
    helm("upgrade", RELEASE, str(CHART), *with_values(without | {"resources.limits.memory": "512Mi"}))
    assert memory_limit(kubectl) == "512Mi"
    helm("rollback", RELEASE)
    assert memory_limit(kubectl) == before


def test_uninstalling_removes_the_operator_and_keeps_the_resources(
    bare_control_plane: ControlPlane, helm: Helm, kubectl: Kubectl
) -> None:
    untouched = kubectl.names(EVERYTHING)
    cluster_wide = kubectl.names("clusterroles,clusterrolebindings")
    helm("install", RELEASE, str(CHART))
    bare_control_plane.wait_served(DEFINITION)
    kubectl.apply(talker())
    said = helm("uninstall", RELEASE, "--wait")
    assert "CustomResourceDefinition" in said  # helm says what it kept
    assert "ValidatingAdmissionPolicy" in said
    policies = kubectl.names("validatingadmissionpolicies,validatingadmissionpolicybindings")
    assert [name.partition("/")[2] for name in policies] == [f"{kubectl.namespace}-{OPERATOR}"] * 2
    kubectl("wait", "--for=delete", "pods", "-l", f"app.kubernetes.io/name={OPERATOR}", "--timeout=110s")
    # A controller that was late may have made a ReplicaSet for the Deployment that has gone; the collector finds it.
    eventually(lambda: kubectl.names(EVERYTHING) == untouched, "nothing of ours", lambda: kubectl.names(EVERYTHING))
    assert kubectl.names("clusterroles,clusterrolebindings") == cluster_wide
    assert kubectl.names("robotoffloads") == ["robotoffload.robotoffload.dev/talker"]


def test_a_later_release_takes_the_kept_definition_over(helm: Helm, kubectl: Kubectl) -> None:
    helm("install", RELEASE, str(CHART))
    helm("uninstall", RELEASE)
    helm("install", RELEASE, str(CHART))
    helm("uninstall", RELEASE)
    assert "invalid ownership metadata" in helm.refuses("install", "of-another-name", str(CHART))
    helm("install", "of-another-name", str(CHART), "--take-ownership")
    assert "deployed" in helm("status", "of-another-name")


def test_objects_of_an_older_definition_live_through_upgrade_and_rollback(
    bare_control_plane: ControlPlane, helm: Helm, kubectl: Kubectl, tmp_path: Path
) -> None:
    older = with_older_definition(tmp_path / "chart", forgotten="scale")
    helm("install", RELEASE, str(older))
    bare_control_plane.wait_served(DEFINITION)
    kubectl.apply(talker())
    assert "scale" not in kubectl.json("get", "robotoffload", "talker")["spec"]

    helm("upgrade", RELEASE, str(CHART))
    kubectl("annotate", "robotoffload", "talker", "touched=yes")  # any write must pass the new validation
    kubectl.apply({**talker(), "spec": {**talker()["spec"], "scale": {"idleTimeout": "5m"}}})

    helm("rollback", RELEASE)
    kept = kubectl.json("get", "robotoffload", "talker")
    assert kept["spec"]["nodes"][0]["name"] == "talker"
    kubectl("annotate", "robotoffload", "talker", "touched=again", "--overwrite")


def test_deleting_the_namespace_with_everything_in_it_leaves_nothing_stuck(
    bare_control_plane: ControlPlane, helm: Helm, kubectl: Kubectl
) -> None:
    helm("install", RELEASE, str(CHART))
    bare_control_plane.wait_served(DEFINITION)
    kubectl.apply(talker())
    kubectl("delete", "namespace", kubectl.namespace, "--timeout=110s")
    assert f"namespace/{kubectl.namespace}" not in kubectl.names("namespaces")
    helm("install", RELEASE, str(CHART), "--create-namespace")  # nothing of the first one is in the way
