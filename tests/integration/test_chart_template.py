"""The chart as text: what helm makes of the values, and what the API server says to it."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Any

import pytest
import yaml

from robot_offload.objects.facts import BUILDER
from robot_offload.runtime.settings import from_environment
from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.definitions import definitions
from tests.integration.chart import CHART, OPERATOR, RELEASE, ROOT, Values, of_kind, rendered, with_values
from tests.integration.conftest import NewNamespace

pytestmark = pytest.mark.api

DIGEST = f"mirror.example:5000/ros/agent@sha256:{'a' * 64}"
SCRAPE = {"enabled": True, "interval": "15s", "labels": {"release": "prometheus"}}
PEER = {"namespaceSelector": {"matchLabels": {"name": "monitoring"}}}

CASES: dict[str, Values] = {
    "defaults": {"crds.install": True},
    "another registry": {"images.registry": "mirror.example:5000/ros", "images.tag": "1.2.3", "images.agent": DIGEST},
    "private registry for robots": {"images.robotPullSecrets": [{"name": "registry"}]},
    "what holds for all pods": {
        "robotPodSpec": {"containers": [{"name": "agent", "resources": {"limits": {"cpu": 1}}}]},
    },
    "a part of another chart": {"enabled": True},
    "private registry": {"images.pullSecrets": [{"name": "registry"}], "images.pullPolicy": "Always"},
    "more to read": {"logLevel": "debug"},
    "cert-manager": {"certManager.enabled": True},
    "own service account": {"serviceAccount.create": False, "serviceAccount.name": "mine"},
    "annotated service account": {"serviceAccount.annotations": {"example.com/role": "arn:1"}},
    "no roles": {"rbac.create": False},
    "not aggregated": {"rbac.aggregate": False},
    "openshift": {"runAsUser": None},
    "resources": {"resources": {"requests": {"cpu": 1, "memory": "1Gi"}, "limits": {"cpu": "2", "memory": "2Gi"}}},
    "scheduling": {
        "nodeSelector": {"kubernetes.io/arch": "amd64"},
        "tolerations": [{"key": "edge", "operator": "Exists", "effect": "NoSchedule"}],
        "affinity": {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": [
            {"matchExpressions": [{"key": "zone", "operator": "In", "values": ["a"]}]}]}}},
        "priorityClassName": "system-cluster-critical",
    },
    "labels and annotations": {"podLabels": {"team": "robots"}, "podAnnotations": {"example.com/a": "yes"}},
    "metrics for one namespace only": {"networkPolicy.metricsFrom": [PEER]},
    "another port of the API server": {"networkPolicy.apiServerPorts": [16443]},
    "two operators": {
        "replicas": 2,
        "topologySpreadConstraints": [
            {"maxSkew": 1, "topologyKey": "zone", "whenUnsatisfiable": "DoNotSchedule", "labelSelector": {}}
        ],
    },
    "settings": {
        "config": {"resyncSeconds": 600, "workers": 8, "leaderLeaseSeconds": 30, "requestTimeoutSeconds": 10},
        "logFormat": "text",
        "extraEnv": [{"name": "HTTPS_PROXY", "value": "http://proxy.example:3128"}],
        "dnsConfig": {"searches": ["a.example"]},
        "revisionHistoryLimit": 2,
        "commonLabels": {"team": "robots"},
    },
    "builds": {"builds.enabled": True, "images.git": "mirror.example/git:1"},
    "no admission policy": {"admission.enabled": False},
    "what everybody may ask for": {
        "admission.allowed": {"serviceAnnotations": ["metallb.io/"], "tolerations": [], "nodeSelector": ["zone"]}
    },
    "no network policy": {"networkPolicy.enabled": False},
    "networks": {"robotNetworkPolicies": {
        "enabled": True, "dns": ["10.96.0.10/32"], "apiServers": ["fd00::1/128"],
        "apiServersFrom": ["192.0.2.0/28", "fd00::/64"], "metricsNamespaces": ["monitoring"]}},
}  # fmt: skip

WRONG: dict[str, tuple[Values, str]] = {
    "a registry with a scheme": ({"images.registry": "https://reg.corp/robots/"}, "registry"),
    "an image with a scheme": ({"images.agent": "https://reg.corp/robots/agent:1"}, "agent"),
    "a host for pods": ({"robotPodSpec": {"hostNetwork": True}}, "hostNetwork"),
    "an unknown key": ({"imagse": {}}, "imagse"),
    "an unknown key further down": ({"images.registyr": "x"}, "registyr"),
    "text for a number": ({"runAsUser": "1000"}, "runAsUser"),
    "root": ({"runAsUser": 0}, "runAsUser"),
    "a number for text": ({"images.tag": 1.2}, "images.tag|images/tag"),
    "no namespace": ({"watchNamespaces": ["Not_A_Namespace"]}, "watchNamespaces"),
    "an unknown pull policy": ({"images.pullPolicy": "Sometimes"}, "pullPolicy"),
    "a reference with a blank": ({"images.agent": "agent :1"}, "agent"),
    "no port": ({"networkPolicy.apiServerPorts": [70000]}, "apiServerPorts"),
    "a pull secret without a name": ({"images.pullSecrets": ["registry"]}, "pullSecrets"),
    "an interval without a unit": ({"metrics.podMonitor.interval": "30"}, "interval"),
    "a network that is none": ({"robotNetworkPolicies.dns": ["10.96.0.10"]}, "dns"),
    "an API server that is no network": ({"robotNetworkPolicies.apiServersFrom": ["192.0.2.1"]}, "apiServersFrom"),
    "an unknown log level": ({"logLevel": "chatty"}, "logLevel"),
    "a missing account name": ({"serviceAccount.create": False}, "serviceAccount.name"),
}


@pytest.mark.parametrize("values", CASES.values(), ids=CASES.keys())
def test_the_api_server_accepts_what_the_chart_renders(helm: Helm, kubectl: Kubectl, values: Values) -> None:
    # The definition once is enough: the API server works for seconds to judge its rules.
    objects = rendered(helm, {"crds.install": False, **values})
    kubectl("apply", "--server-side", "--dry-run=server", "-f", "-", stdin=yaml.safe_dump_all(objects))


def test_the_api_server_accepts_a_chart_for_one_namespace(
    helm: Helm, kubectl: Kubectl, new_namespace: NewNamespace
) -> None:
    objects = rendered(helm, {"watchNamespaces": [new_namespace()], "crds.install": False})
    kubectl.within("")("apply", "--server-side", "--dry-run=server", "-f", "-", stdin=yaml.safe_dump_all(objects))


@pytest.mark.parametrize("name", ["defaults", "cert-manager", "openshift", "scheduling"])
def test_lint_has_nothing_to_say(helm: Helm, name: str) -> None:
    assert "0 chart(s) failed" in helm("lint", "--strict", str(CHART), *with_values(CASES[name]))


@pytest.mark.parametrize(("values", "named"), WRONG.values(), ids=WRONG.keys())
def test_wrong_values_are_refused_and_named(helm: Helm, values: Values, named: str) -> None:
    refusal = helm.refuses("template", RELEASE, str(CHART), *with_values(values))
    assert any(each in refusal for each in named.split("|")), refusal


def test_every_value_is_in_the_schema_with_a_description() -> None:
    schema = yaml.safe_load((CHART / "values.schema.json").read_text())
    values = yaml.safe_load((CHART / "values.yaml").read_text())
    assert undescribed(values, schema, "values") == []


def undescribed(values: dict[str, Any], schema: dict[str, Any], path: str) -> list[str]:
    missing = [f"{path}.{key}" for key in values if not schema["properties"].get(key, {}).get("description", True)]
    for key, value in values.items():
        inner = schema["properties"].get(key)
        if inner is None:
            missing.append(f"{path}.{key}")
        elif isinstance(value, dict) and "properties" in inner:
            missing += undescribed(value, inner, f"{path}.{key}")
    return missing


def container(objects: list[dict[str, Any]]) -> dict[str, Any]:
    (deployment,) = of_kind(objects, "Deployment")
    (only,) = deployment["spec"]["template"]["spec"]["containers"]
    assert isinstance(only, dict)
    return only


def environment(objects: list[dict[str, Any]]) -> dict[str, str]:
    return {each["name"]: each.get("value", "") for each in container(objects)["env"]}


def test_every_image_has_the_version_of_the_chart(helm: Helm) -> None:
    version = yaml.safe_load((CHART / "Chart.yaml").read_text())["appVersion"]
    told = environment(rendered(helm))
    for name in ("operator", "agent", "discovery", "router"):
        assert told[f"{name.upper()}_IMAGE"] == f"registry.robotoffload.dev/{name}:{version}"


def test_the_list_of_images_has_every_one_that_the_chart_names(helm: Helm) -> None:
    told = environment(rendered(helm, {"builds.enabled": True}))
    listed = (ROOT / "manifests/images.txt").read_text().split()
    assert sorted(value for name, value in told.items() if name.endswith("_IMAGE")) == sorted(listed)


def test_the_operator_builds_only_where_that_is_allowed_and_fetches_with_the_charts_image(helm: Helm) -> None:
    assert environment(rendered(helm))["GIT_IMAGE"] == ""
    version = yaml.safe_load((CHART / "Chart.yaml").read_text())["appVersion"]
    allowed = environment(rendered(helm, {"builds.enabled": True}))
    assert allowed["GIT_IMAGE"] == f"registry.robotoffload.dev/git:{version}"
    assert environment(rendered(helm, CASES["builds"]))["GIT_IMAGE"] == "mirror.example/git:1"


def test_a_registry_serves_all_images_and_a_reference_only_its_own(helm: Helm) -> None:
    objects = rendered(helm, CASES["another registry"])
    told = environment(objects)
    assert container(objects)["image"] == told["OPERATOR_IMAGE"] == "mirror.example:5000/ros/operator:1.2.3"
    assert told["AGENT_IMAGE"] == DIGEST


def test_the_builder_is_the_one_that_the_operator_knows_and_may_be_another(helm: Helm) -> None:
    assert environment(rendered(helm))["BUILDER_IMAGE"] == BUILDER
    assert (
        environment(rendered(helm, {"images.builder": "mirror.example/b:1"}))["BUILDER_IMAGE"] == "mirror.example/b:1"
    )


def test_a_second_operator_waits_beside_the_first_and_one_of_them_may_always_go(helm: Helm) -> None:
    alone, both = rendered(helm), rendered(helm, CASES["two operators"])
    assert of_kind(alone, "Deployment")[0]["spec"]["strategy"] == {"type": "Recreate"}
    assert of_kind(alone, "PodDisruptionBudget") == []
    (deployment,) = of_kind(both, "Deployment")
    assert (deployment["spec"]["replicas"], deployment["spec"]["strategy"]["type"]) == (2, "RollingUpdate")
    assert [each["spec"]["maxUnavailable"] for each in of_kind(both, "PodDisruptionBudget")] == [1]


def test_every_object_carries_the_common_labels(helm: Helm) -> None:
    labels = [each["metadata"].get("labels", {}) for each in rendered(helm, CASES["settings"])]
    assert all(found.get("team") == "robots" for found in labels)


def test_the_operator_learns_which_namespace_to_serve(helm: Helm) -> None:
    assert environment(rendered(helm, {"watchNamespaces": ["robots"]}))["WATCH_NAMESPACE"] == "robots"
    assert environment(rendered(helm))["WATCH_NAMESPACE"] == ""


def test_the_charts_definition_is_the_one_of_the_manifests(helm: Helm) -> None:
    (ours,) = of_kind(rendered(helm), "CustomResourceDefinition")
    (published,) = yaml.safe_load_all(definitions()[0].read_text())
    assert ours["spec"] == published["spec"]
    assert ours["metadata"]["annotations"]["helm.sh/resource-policy"] == "keep"


def test_selectors_do_not_match_what_the_operator_makes_for_a_robot(helm: Helm) -> None:
    (deployment,) = of_kind(rendered(helm), "Deployment")
    assert deployment["spec"]["selector"]["matchLabels"]["app.kubernetes.io/name"] == OPERATOR


def test_alerts_link_to_a_page_only_when_somebody_says_where_the_page_is(helm: Helm) -> None:
    for base, linked in (("", False), ("https://wiki.example/alerts", True)):
        values = {"metrics.alerts.enabled": True, "metrics.alerts.runbooks": base}
        [found] = of_kind(rendered(helm, values), "PrometheusRule")
        alerts = found["spec"]["groups"][0]["rules"]
        assert {"runbook_url" in rule["annotations"] for rule in alerts} == {linked}
        assert all(rule["annotations"]["summary"] for rule in alerts)


def test_monitors_are_accepted_where_the_prometheus_operator_is(bare_control_plane: ControlPlane, helm: Helm) -> None:
    kubectl = bare_control_plane.kubectl()
    kinds = {"podmonitors": "PodMonitor", "servicemonitors": "ServiceMonitor", "prometheusrules": "PrometheusRule"}
    for plural, kind in kinds.items():
        kubectl.apply(monitoring_definition(plural, kind))
        bare_control_plane.wait_served(monitoring_definition(plural, kind))
    alerts = {"enabled": True, "labels": {"release": "prometheus"}, "certificateDays": 7}
    wanted = {f"metrics.{name}": SCRAPE for name in ("podMonitor", "serviceMonitor", "agentMonitor")}
    objects = rendered(helm, {**wanted, "metrics.alerts": alerts})
    monitors = [each for kind in kinds.values() for each in of_kind(objects, kind)]
    assert len(monitors) == 4
    (alerting,) = of_kind(objects, "PrometheusRule")
    rules = {rule["alert"]: rule for rule in alerting["spec"]["groups"][0]["rules"]}
    assert rules["RobotOffloadCertificateEnding"]["expr"].endswith("- time() < 604800")
    told = set(re.findall(r"robot_offload_[a-z_]+", " ".join(rule["expr"] for rule in rules.values())))
    known = (ROOT / "docs/reference/metrics.md").read_text()
    assert [name for name in told if name not in known] == []
    for monitor in monitors:
        del monitor["metadata"]["namespace"]
    kubectl("apply", "--server-side", "--dry-run=server", "-f", "-", stdin=yaml.safe_dump_all(monitors))


def monitoring_definition(plural: str, kind: str) -> dict[str, Any]:
    """The fields of the Prometheus operator's definition that the chart may use, with their types; no others."""
    text = {"type": "string"}
    labels = {"type": "object", "properties": {"matchLabels": {"type": "object", "additionalProperties": text}}}
    endpoint = {
        "type": "object",
        "properties": {"port": text, "path": text, "interval": text, "honorLabels": {"type": "boolean"}},
    }
    endpoints = "podMetricsEndpoints" if kind == "PodMonitor" else "endpoints"
    places = {
        "type": "object",
        "properties": {"any": {"type": "boolean"}, "matchNames": {"type": "array", "items": text}},
    }
    more = {"namespaceSelector": places, "podTargetLabels": {"type": "array", "items": text}}
    fields: dict[str, Any] = {"selector": labels, endpoints: {"type": "array", "items": endpoint}, **more}
    if kind == "PrometheusRule":
        texts = {"type": "object", "additionalProperties": text}
        rule = {"alert": text, "expr": text, "for": text, "labels": texts, "annotations": texts}
        rules = {"type": "array", "items": {"type": "object", "properties": rule}}
        group = {"type": "object", "properties": {"name": text, "rules": rules}}
        fields = {"groups": {"type": "array", "items": group}}
    spec = {"type": "object", "properties": fields}
    schema = {"openAPIV3Schema": {"type": "object", "properties": {"spec": spec}}}
    names = {"plural": plural, "kind": kind, "singular": kind.lower(), "listKind": f"{kind}List"}
    versions = [{"name": "v1", "served": True, "storage": True, "schema": schema}]
    return {
        "apiVersion": "apiextensions.k8s.io/v1",
        "kind": "CustomResourceDefinition",
        "metadata": {"name": f"{plural}.monitoring.coreos.com"},
        "spec": {"group": "monitoring.coreos.com", "scope": "Namespaced", "names": names, "versions": versions},
    }


def test_the_install_manifest_is_what_the_chart_renders(cluster_programs: object) -> None:
    command = [sys.executable, "-m", "scripts.install_manifest", "--check"]
    check = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert check.returncode == 0, check.stderr


def test_the_install_manifest_can_be_applied_and_deleted(bare_control_plane: ControlPlane) -> None:
    kubectl = bare_control_plane.kubectl("robot-offload-system")
    manifests = ("-f", str(ROOT / "manifests" / "crd"), "-f", str(ROOT / "manifests" / "install.yaml"))
    kinds = "namespaces,clusterroles,clusterrolebindings,customresourcedefinitions"
    before = kubectl.names(kinds)
    kubectl("apply", "--server-side", *manifests)
    kubectl("wait", "--for=create", "pods", "-l", f"app.kubernetes.io/name={OPERATOR}", "--timeout=110s")
    kubectl("delete", *manifests, "--timeout=110s")
    assert set(kubectl.names(kinds)) <= set(before)  # a namespace of another test may have gone meanwhile


def notes(helm: Helm, values: Values) -> str:
    """What helm prints after an installation with these values."""
    told = helm("install", RELEASE, str(CHART), "--dry-run=client", *with_values({"crds.install": False, **values}))
    return told.partition("NOTES:")[2]


def test_the_notes_say_what_is_needed_before_anything_can_start(helm: Helm) -> None:
    plain = notes(helm, {})
    assert "No public registry holds the images" in plain
    assert "make images REGISTRY=registry.example/robots ARGS=--push" in plain
    assert "spec.transport.expose.type: NodePort" in plain
    private = notes(
        helm,
        {"images.registry": "mirror.example/ros", "images.robotPullSecrets": [{"name": "a"}, {"name": "b"}]},
    )
    assert "No public registry" not in private
    assert "needs the Secrets a, b" in private


def test_what_holds_for_all_pods_reaches_the_operator_as_it_reads_it(helm: Helm) -> None:
    part = {"containers": [{"name": "agent", "resources": {"limits": {"cpu": "1"}}}], "priorityClassName": "robots"}
    objects = rendered(helm, {"robotPodSpec": part, "images.robotPullSecrets": [{"name": "a"}, {"name": "b"}]})
    environment = {one["name"]: one.get("value", "") for one in container(objects)["env"]}
    images = dict.fromkeys(("AGENT_IMAGE", "OPERATOR_IMAGE", "DISCOVERY_IMAGE", "ROUTER_IMAGE"), "x")
    settings = from_environment({**environment, **images, "POD_NAME": "p", "POD_NAMESPACE": "n"})
    assert settings.policy.pod_spec == part
    assert settings.policy.pull_secrets == ("a", "b")
    assert settings.keep.days == 30
    assert settings.policy.admission == next(iter(of_kind(objects, "ValidatingAdmissionPolicy")))["metadata"]["name"]
