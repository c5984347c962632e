"""The operator's rights: what it uses, no more and no less, in all namespaces or in one."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robot_offload.kube.kinds import USES, Use
from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.chart import CHART, OPERATOR, RELEASE, of_kind, rendered, with_values
from tests.integration.conftest import NewNamespace

pytestmark = [pytest.mark.api, pytest.mark.core]

Right = tuple[str, str, str]  # API group, resource, verb
CERT_MANAGER = {"certManager.enabled": True}


def used(*uses: Use) -> set[Right]:
    return {
        (use.kind.group, f"{use.kind.plural}/{use.subresource}".rstrip("/"), verb) for use in uses for verb in use.verbs
    }


def granted(*roles: dict[str, Any]) -> set[Right]:
    return {
        (group, resource, verb)
        for role in roles
        for rule in role["rules"]
        for group in rule["apiGroups"]
        for resource in rule["resources"]
        for verb in rule["verbs"]
    }


def bound_roles(objects: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The roles that a binding gives to the operator; not those for users."""
    names = {
        each["roleRef"]["name"] for kind in ("ClusterRoleBinding", "RoleBinding") for each in of_kind(objects, kind)
    }
    return [
        each for kind in ("ClusterRole", "Role") for each in of_kind(objects, kind) if each["metadata"]["name"] in names
    ]


def test_the_role_for_all_namespaces_grants_exactly_what_the_operator_uses(helm: Helm) -> None:
    assert granted(*bound_roles(rendered(helm, CERT_MANAGER))) == used(*USES)


def test_optional_uses_are_granted_only_when_asked_for(helm: Helm) -> None:
    always = [use for use in USES if not use.optional]
    assert granted(*bound_roles(rendered(helm))) == used(*always)


def test_the_role_for_one_namespace_grants_the_same_without_what_lives_in_none(helm: Helm) -> None:
    objects = rendered(helm, {"watchNamespaces": [helm.namespace], **CERT_MANAGER})
    within = [use for use in USES if use.kind.namespaced]
    (role,) = bound_roles(objects)
    assert role["kind"] == "Role"
    assert granted(role) == used(*within)
    assert of_kind(objects, "ClusterRoleBinding") == []


def test_an_operator_for_several_namespaces_has_a_role_in_each_and_none_for_all(helm: Helm) -> None:
    objects = rendered(helm, {"watchNamespaces": ["a", "b"]})
    within = [use for use in USES if use.kind.namespaced and not use.optional]
    roles = [role for role in of_kind(objects, "Role") if role["metadata"]["namespace"] in ("a", "b")]
    assert [role["metadata"]["namespace"] for role in roles] == ["a", "b"]
    assert all(granted(role) == used(*within) for role in roles)
    assert of_kind(objects, "ClusterRoleBinding") == []


def test_an_operator_beside_its_namespaces_has_its_lease_and_the_authorities_keys_at_home(helm: Helm) -> None:
    objects = rendered(helm, {"watchNamespaces": ["robots"]})
    lease = [role for role in of_kind(objects, "Role") if role["metadata"]["name"] == f"{OPERATOR}-leader"]
    assert {role["metadata"]["namespace"] for role in lease} == {helm.namespace}
    keys = {("", "secrets", verb) for verb in ("get", "list", "watch", "create", "patch", "delete")}
    assert granted(*lease) == keys | {("coordination.k8s.io", "leases", verb) for verb in ("get", "create", "patch")}


def test_no_role_holds_a_wildcard(helm: Helm) -> None:
    objects = rendered(helm, CERT_MANAGER)
    assert not any("*" in right for right in granted(*of_kind(objects, "ClusterRole"), *of_kind(objects, "Role")))


def operator_of(control_plane: ControlPlane, namespace: str) -> Kubectl:
    """Kubectl with the rights of the installed operator."""
    admin = control_plane.kubectl(namespace)
    return Kubectl(admin.program, control_plane.kubeconfig_of(namespace, OPERATOR), namespace)


def may(operator: Kubectl, verb: str, resource: str, namespace: str) -> bool:
    """Whether the real API server would let the operator do it."""
    review = {
        "apiVersion": "authorization.k8s.io/v1",
        "kind": "SelfSubjectAccessReview",
        "spec": {
            "resourceAttributes": {
                "namespace": namespace,
                "verb": verb,
                "group": resource.partition(".")[2],
                "resource": resource.partition(".")[0],
            }
        },
    }
    answer = json.loads(operator("create", "--validate=false", "-o", "json", "-f", "-", stdin=json.dumps(review)))
    return bool(answer["status"]["allowed"])


def test_an_operator_for_one_namespace_can_do_nothing_in_another(
    control_plane: ControlPlane, helm: Helm, new_namespace: NewNamespace
) -> None:
    mine, other = helm.namespace, new_namespace()
    values = {"watchNamespaces": [mine], "crds.install": False}
    helm("install", RELEASE, str(CHART), *with_values(values))
    operator = operator_of(control_plane, mine)
    assert may(operator, "patch", "deployments.apps", mine)
    assert not may(operator, "list", "secrets", other)
    assert not may(operator, "list", "nodes", "")


def test_the_operator_may_grant_the_reporter_its_lease_and_nothing_it_has_not_itself(
    control_plane: ControlPlane, helm: Helm
) -> None:
    helm("install", RELEASE, str(CHART), *with_values({"watchNamespaces": [helm.namespace], "crds.install": False}))
    operator = operator_of(control_plane, helm.namespace)
    operator.apply(role("reporter", "coordination.k8s.io", "leases", "get", "patch"))
    assert "is attempting to grant RBAC permissions not currently held" in operator.apply_refused(
        role("greedy", "", "pods/exec", "create")
    )


def role(name: str, group: str, resource: str, *verbs: str) -> dict[str, Any]:
    rules = [{"apiGroups": [group], "resources": [resource], "verbs": list(verbs)}]
    return {
        "apiVersion": "rbac.authorization.k8s.io/v1",
        "kind": "Role",
        "metadata": {"name": name},
        "rules": rules,
    }


def test_users_who_may_edit_a_namespace_may_edit_its_robots(control_plane: ControlPlane, helm: Helm) -> None:
    edit = [each for each in of_kind(rendered(helm), "ClusterRole") if each["metadata"]["name"].endswith("-edit")]
    assert {verb for _, resource, verb in granted(*edit) if resource == "robotoffloads"} >= {
        "create",
        "patch",
        "delete",
    }
    assert edit[0]["metadata"]["labels"]["rbac.authorization.k8s.io/aggregate-to-edit"] == "true"
