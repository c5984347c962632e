"""What a user gains who may write RobotOffloads and nothing else: a test for each line of the threat model.

The API server is real, the policies are those of the chart, and the user is `rob`, by impersonation.
"""

from __future__ import annotations

import itertools
import json
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.decide import admission
from robot_offload.decide.admission import REACH
from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.errors import CommandError
from tests.contract.hostile import HOSTILE
from tests.contract.rule_examples import BUILD
from tests.integration.chart import CHART, OPERATOR, RELEASE, of_kind, rendered, with_values
from tests.integration.operator_cluster import Place, eventually
from tests.integration.operator_process import Operator
from tests.unit.specs import sample

pytestmark = pytest.mark.api

POLICIES = ("ValidatingAdmissionPolicy", "ValidatingAdmissionPolicyBinding")
BUILT = {
    "name": "planner",
    "placement": "Cloud",
    "run": {"command": ["planner"]},
    "build": {**BUILD, "git": {"url": "https://git.example/a.git"}},
}
REGISTRY = {"repository": "registry.example/robots"}


class Rob:
    """A user who may write RobotOffloads in one namespace, and what they are told."""

    _users = itertools.count(1)

    def __init__(self, kubectl: Kubectl) -> None:
        self.name = f"rob-{next(self._users)}"
        self._kubectl = kubectl
        self.allow("robotoffload.dev", "robotoffloads", "get", "list", "create", "update", "patch")

    @property
    def identity(self) -> tuple[str, str]:
        """Arguments of kubectl."""
        return "--as", self.name

    def allow(self, group: str, resource: str, *verbs: str) -> None:
        """One more right; returns when the API server knows of it, which takes it a moment."""
        metadata = {"name": f"{self.name}-{resource}", "namespace": self._kubectl.namespace}
        rules = [{"apiGroups": [group], "resources": [resource], "verbs": list(verbs)}]
        rbac = "rbac.authorization.k8s.io"
        role = {"apiVersion": f"{rbac}/v1", "kind": "Role", "metadata": metadata}
        reference = {"apiGroup": rbac, "kind": "Role", "name": metadata["name"]}
        subjects = [{"kind": "User", "name": self.name, "apiGroup": rbac}]
        bound = {**role, "kind": "RoleBinding", "roleRef": reference, "subjects": subjects}
        self._kubectl("apply", "-f", "-", stdin=yaml.safe_dump_all([{**role, "rules": rules}, bound]))
        asked = {"namespace": self._kubectl.namespace, "verb": verbs[0], "group": group, "resource": resource}
        eventually(lambda: self._may(asked), f"the right of {self.name} to {verbs[0]} {resource}")

    def _may(self, asked: dict[str, str]) -> bool:
        spec = {"user": self.name, "resourceAttributes": asked}
        review = {"apiVersion": "authorization.k8s.io/v1", "kind": "SubjectAccessReview", "spec": spec}
        answer = self._kubectl("create", "--validate=false", "-o", "json", "-f", "-", stdin=json.dumps(review))
        return bool(json.loads(answer)["status"]["allowed"])

    def writes(self, manifest: dict[str, Any]) -> str:
        """Returns what the API server says against it; empty: it is taken."""
        try:
            self._kubectl("create", *self.identity, "--dry-run=server", "-f", "-", stdin=json.dumps(manifest))
        except CommandError as error:
            return str(error)
        return ""


@contextmanager
def protected(plane: ControlPlane, name: str, **values: Any) -> Iterator[Kubectl]:
    """A namespace in which the chart's policy counts."""
    kubectl = plane.kubectl(plane.new_namespace(f"{name}-{secrets.token_hex(3)}"))
    objects = rendered(plane.helm(kubectl.namespace), {"watchNamespaces": [kubectl.namespace], **values})
    policies = yaml.safe_dump_all([each for kind in POLICIES for each in of_kind(objects, kind)])
    kubectl("apply", "--server-side", "-f", "-", stdin=policies)
    forbidden, somebody = changed(cloud={"imagePullSecrets": [{"name": "s"}]}), Rob(kubectl)
    eventually(lambda: bool(somebody.writes(forbidden)), "the policy to count", lambda: None)
    yield kubectl
    kubectl("delete", "--ignore-not-found", "-f", "-", stdin=policies)
    plane.request("DELETE", f"/api/v1/namespaces/{kubectl.namespace}")


@pytest.fixture(scope="module")
def place(control_plane: ControlPlane) -> Iterator[Kubectl]:
    with protected(control_plane, "tenants") as kubectl:
        yield kubectl


@pytest.fixture
def rob(place: Kubectl) -> Rob:
    return Rob(place)


def changed(nodes: list[dict[str, Any]] | None = None, **blocks: Any) -> dict[str, Any]:
    """The sample with other blocks of its specification."""
    manifest = sample()
    manifest["spec"] |= blocks | ({"nodes": nodes} if nodes else {})
    if "cloud" in blocks:
        manifest["spec"]["cloud"].setdefault("domainID", 43)
    return manifest


def with_node(**fields: Any) -> dict[str, Any]:
    """The sample with another planner."""
    nodes = sample()["spec"]["nodes"]
    return changed([*nodes[:2], {**nodes[2], **fields}])


def exposed(**fields: Any) -> dict[str, Any]:
    return changed(transport={"type": "Zenoh", "expose": fields})


ASKED: tuple[tuple[str, dict[str, Any], tuple[str, str, str]], ...] = (
    ("image pull Secrets", changed(cloud={"imagePullSecrets": [{"name": "s"}]}), ("", "secrets", "get")),
    ("a push Secret", changed(cloud={"registry": {**REGISTRY, "pushSecret": {"name": "s"}}}), ("", "secrets", "get")),
    ("a pull Secret", changed(cloud={"registry": {**REGISTRY, "pullSecret": {"name": "s"}}}), ("", "secrets", "get")),
    (
        "a ConfigMap",
        with_node(run={"command": ["p"], "parametersFrom": {"configMapKeyRef": {"name": "c", "key": "k"}}}),
        ("", "configmaps", "get"),
    ),
    (
        "a Secret for a variable",
        with_node(env=[{"name": "TOKEN", "valueFrom": {"secretKeyRef": {"name": "s", "key": "k"}}}]),
        ("", "secrets", "get"),
    ),
    (
        "a ConfigMap for a variable",
        with_node(env=[{"name": "MAP", "valueFrom": {"configMapKeyRef": {"name": "c", "key": "k"}}}]),
        ("", "configmaps", "get"),
    ),
    (
        "an issuer",
        changed(transport={"type": "Zenoh", "certificates": {"issuerRef": {"name": "all", "kind": "ClusterIssuer"}}}),
        ("cert-manager.io", "certificates", "create"),
    ),
    ("an address", exposed(address="192.0.2.1"), ("", "services", "create")),
    ("a load balancer class", exposed(loadBalancerClass="a.example/b"), ("", "services", "create")),
    ("ports of the nodes", exposed(nodePorts={"pulse": 30001}), ("", "services", "create")),
    (
        "annotations of Services",
        exposed(annotations={"external-dns.alpha.kubernetes.io/hostname": "www.example.com"}),
        ("", "services", "create"),
    ),
    ("every taint", changed(cloud={"tolerations": [{"operator": "Exists"}]}), ("", "pods", "create")),
    (
        "the control plane's nodes",
        changed(cloud={"nodeSelector": {"node-role.kubernetes.io/control-plane": ""}}),
        ("", "pods", "create"),
    ),
    ("a node's node", with_node(nodeSelector={"kubernetes.io/hostname": "a"}), ("", "pods", "create")),
    ("a priority", changed(cloud={"podSpec": {"priorityClassName": "high"}}), ("", "pods", "create")),
    (
        "a claim on storage",
        with_node(podSpec={"volumes": [{"name": "maps", "persistentVolumeClaim": {"claimName": "maps"}}]}),
        ("", "pods", "create"),
    ),
    ("a runtime class", with_node(runtimeClassName="privileged"), ("", "pods", "create")),
)


def test_a_plain_robot_needs_no_further_right(rob: Rob) -> None:
    assert rob.writes(sample()) == ""
    gpu = changed(cloud={"tolerations": [{"key": "nvidia.com/gpu", "operator": "Exists"}]})
    assert rob.writes(gpu) == ""
    limits = {"containers": [{"name": "agent", "resources": {"limits": {"cpu": "1"}}}]}
    assert rob.writes(changed(cloud={"podSpec": limits})) == ""


@pytest.mark.parametrize(("what", "manifest", "right"), ASKED, ids=[what for what, *_ in ASKED])
def test_who_asks_for_more_needs_the_right_to_it(
    rob: Rob, what: str, manifest: dict[str, Any], right: tuple[str, str, str]
) -> None:
    assert f"you need the right to {right[2]} {right[1]}" in rob.writes(manifest)
    rob.allow(*right)
    assert rob.writes(manifest) == ""


@pytest.mark.parametrize(("what", "manifest", "right"), ASKED, ids=[what for what, *_ in ASKED])
def test_the_operator_knows_what_the_policy_guards(
    what: str, manifest: dict[str, Any], right: tuple[str, str, str]
) -> None:
    assert admission.asks(parse_object(manifest, what))
    assert not admission.asks(parse_object(sample(), "plain"))


def test_what_was_written_without_a_policy_acts_when_somebody_with_the_rights_vouches_for_it(
    control_plane: ControlPlane, tmp_path: Path
) -> None:
    kubectl = control_plane.kubectl(control_plane.new_namespace(f"gap-{secrets.token_hex(3)}"))
    rob, seen = Rob(kubectl), Place(control_plane, kubectl.namespace)
    thief = with_node(env=[{"name": "KEY", "valueFrom": {"secretKeyRef": {"name": "w-cloud", "key": "tls.key"}}}])
    kubectl("create", *rob.identity, "-f", "-", stdin=json.dumps(thief))
    objects = rendered(control_plane.helm(kubectl.namespace), {"watchNamespaces": [kubectl.namespace]})
    policies = [each for kind in POLICIES for each in of_kind(objects, kind)]
    name = policies[0]["metadata"]["name"]
    operator = Operator.start(
        control_plane.kubeconfig, tmp_path / "log", WATCH_NAMESPACE=kubectl.namespace, ADMISSION_POLICY=name
    )
    robot = thief["metadata"]["name"]
    try:
        assert name in seen.wait_condition("SpecValid", "False", "NotAdmitted", name=robot)["message"]
        time.sleep(REACH.total_seconds())  # as late as an administrator
        kubectl("apply", "--server-side", "-f", "-", stdin=yaml.safe_dump_all(policies))
        uid = kubectl.json("get", "validatingadmissionpolicy", name)["metadata"]["uid"]
        vouch = ("annotate", "roff", robot, "--overwrite", f"{admission.ADMITTED}={uid}")
        eventually(lambda: "right to get secrets" in refused(kubectl, *vouch, *rob.identity), "the policy to count")
        assert seen.children(robot) == {}
        kubectl(*vouch)
        seen.wait_condition("ResourcesApplied", "True", name=robot)
    finally:
        operator.stop()
        kubectl("delete", "--ignore-not-found", "-f", "-", stdin=yaml.safe_dump_all(policies))


def refused(kubectl: Kubectl, *arguments: str) -> str:
    """What a dry run is refused with; empty: it is not."""
    try:
        kubectl(*arguments, "--dry-run=server")
    except CommandError as error:
        return str(error)
    return ""


def test_nothing_is_built_where_the_administrator_has_not_allowed_it(rob: Rob) -> None:
    assert "builds.enabled" in rob.writes(changed([BUILT], cloud={"registry": REGISTRY}))


def test_where_builds_are_allowed_they_need_rights_to_jobs_and_to_the_secret_of_the_source(
    control_plane: ControlPlane,
) -> None:
    build = {**BUILT["build"], "gitSecret": {"name": "wheelchair-client-ca"}}
    thief = changed([{**BUILT, "build": build}], cloud={"registry": REGISTRY})
    plain = changed([BUILT], cloud={"registry": REGISTRY})
    with protected(control_plane, "builds", **{"builds.enabled": True}) as kubectl:
        rob = Rob(kubectl)
        assert "you need the right to create jobs" in rob.writes(plain)
        rob.allow("batch", "jobs", "create")
        assert rob.writes(plain) == ""
        assert "you need the right to get secrets" in rob.writes(thief)


def test_a_pin_asks_for_nothing_that_was_not_asked_for_before(rob: Rob, place: Kubectl) -> None:
    place.apply(changed(cloud={"imagePullSecrets": [{"name": "s"}]}))
    patch = ("patch", *rob.identity, "roff", "wheelchair-7", "--type=merge", "-p")
    place(*patch, json.dumps({"spec": {"switching": {"pin": "Robot"}}}))
    more = {"spec": {"cloud": {"imagePullSecrets": [{"name": "s"}, {"name": "t"}]}}}
    assert "right to get secrets" in place.refuses(*patch, json.dumps(more))


@pytest.mark.parametrize(
    "field", ["serviceAccountName", "hostNetwork", "hostPID", "volumes", "securityContext", "privileged", "hostPath"]
)
def test_a_robotoffload_has_no_word_for_the_host_or_for_another_identity(rob: Rob, field: str) -> None:
    assert "unknown field" in rob.writes(with_node(**{field: True}))


def test_annotations_that_the_administrator_allows_need_no_right(control_plane: ControlPlane) -> None:
    with protected(control_plane, "notes", **{"admission.allowed.serviceAnnotations": ["metallb.io/"]}) as kubectl:
        rob = Rob(kubectl)
        assert rob.writes(exposed(annotations={"metallb.io/pool": "robots"})) == ""
        assert "right to create services" in rob.writes(exposed(annotations={"a.example/b": "c"}))


def test_pull_secrets_of_the_platform_need_no_right(control_plane: ControlPlane) -> None:
    with protected(control_plane, "pulls", **{"images.robotPullSecrets": [{"name": "registry"}]}) as kubectl:
        rob = Rob(kubectl)
        assert rob.writes(changed(cloud={"imagePullSecrets": [{"name": "registry"}]})) == ""
        assert "right to get secrets" in rob.writes(changed(cloud={"imagePullSecrets": [{"name": "other"}]}))


def test_what_is_hostile_is_refused_to_rob_when_it_is_written(rob: Rob) -> None:
    taken = [hostile.name for hostile in HOSTILE if hostile.by_server and not rob.writes(hostile.values)]
    assert taken == []


def test_what_is_hostile_and_gets_past_the_api_server_makes_nothing_and_says_what_to_write(
    place: Kubectl, control_plane: ControlPlane, tmp_path: Path
) -> None:
    rob = Rob(place)  # with the rights of an editor: the policy is not what refuses these
    for group, resource, verb in (("", "services", "create"), ("", "pods", "create"), ("", "configmaps", "get")):
        rob.allow(group, resource, verb)
    hostile = {f"hostile-{number}": each for number, each in enumerate(it for it in HOSTILE if not it.by_server)}
    for name, each in hostile.items():
        values = each.values
        values["metadata"]["name"] = name
        place("create", *rob.identity, "-f", "-", stdin=json.dumps(values))
    seen = Place(control_plane, place.namespace)
    operator = Operator.start(control_plane.kubeconfig, tmp_path / "operator.log", WATCH_NAMESPACE=place.namespace)
    try:
        for name, each in hostile.items():
            condition = seen.wait_condition("SpecValid", "False", name=name)
            assert each.advice in condition["message"], (each.name, condition["message"])
            assert seen.children(name) == {}, each.name
    finally:
        operator.stop()
    place("delete", "roff", *hostile)


def test_the_operator_may_own_children_where_owners_are_guarded_as_in_openshift(
    control_plane: ControlPlane, helm: Helm
) -> None:

    place = helm.namespace
    helm("install", RELEASE, str(CHART), *with_values({"watchNamespaces": [place], "crds.install": False}))
    administrator = control_plane.kubectl(place)
    administrator.apply(sample())
    uid = administrator.json("get", "roff", "wheelchair-7")["metadata"]["uid"]
    operator = Kubectl(administrator.program, control_plane.kubeconfig_of(place, OPERATOR), place)
    owner = {"apiVersion": "robotoffload.dev/v1alpha1", "kind": "RobotOffload", "name": "wheelchair-7", "uid": uid}
    metadata = {"name": "child", "ownerReferences": [{**owner, "controller": True, "blockOwnerDeletion": True}]}
    operator.apply({"apiVersion": "v1", "kind": "ConfigMap", "metadata": metadata})
    helm("uninstall", RELEASE)
