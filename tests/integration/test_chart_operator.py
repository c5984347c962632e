"""The operator with nothing but the rights and the settings that the chart gives it."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robot_offload.kube.kinds import DEPLOYMENT, ROBOT_OFFLOAD, USES
from robot_offload.runtime.settings import from_environment
from robot_offload_lab.cluster.commands import Helm
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.chart import CHART, OPERATOR, RELEASE, of_kind, rendered, with_values
from tests.integration.operator_cluster import Place
from tests.integration.operator_process import Operator
from tests.integration.resources import talker

pytestmark = pytest.mark.api

Right = tuple[str, str, str]  # API group, resource, verb


def settings_of(objects: list[dict[str, Any]]) -> dict[str, str]:
    """The environment that the chart gives to the operator."""
    (deployment,) = of_kind(objects, "Deployment")
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    return {each["name"]: each.get("value", "from the Pod") for each in container["env"]}


def test_the_operator_understands_the_environment_that_the_chart_gives_it(helm: Helm) -> None:
    told = settings_of(rendered(helm, {"watchNamespaces": ["robots"], "logLevel": "debug", "images.tag": "9"}))
    settings = from_environment(told)
    assert (settings.watch_namespaces, settings.log_level) == (("robots",), "debug")
    assert settings.images.agent == "registry.robotoffload.dev/agent:9"
    # The ports of probes, Service and policy are those that it opens when nobody says otherwise.
    (deployment,) = of_kind(rendered(helm), "Deployment")
    ports = deployment["spec"]["template"]["spec"]["containers"][0]["ports"]
    assert [each["containerPort"] for each in ports] == [settings.metrics_port, settings.health_port]


@pytest.fixture
def system(bare_control_plane: ControlPlane) -> str:
    return bare_control_plane.new_namespace(f"system-{secrets.token_hex(3)}")


@pytest.fixture
def robots(bare_control_plane: ControlPlane) -> Place:
    return Place(bare_control_plane, bare_control_plane.new_namespace(f"robots-{secrets.token_hex(3)}"))


@pytest.fixture
def forget_installation(bare_control_plane: ControlPlane, system: str, robots: Place) -> Iterator[None]:
    """Afterwards nothing of the release is left, nor its definition."""
    yield
    bare_control_plane.helm(system)("uninstall", RELEASE)
    kubectl = bare_control_plane.kubectl()
    kubectl("delete", "crd", "robotoffloads.robotoffload.dev", "--timeout=110s")
    policies = "validatingadmissionpolicies,validatingadmissionpolicybindings"
    kubectl("delete", policies, "-l", f"app.kubernetes.io/name={OPERATOR}")
    kubectl("delete", "namespace", system, robots.namespace, "--wait=false")


def asked(plane: ControlPlane, user: str) -> Iterator[tuple[Right, int]]:
    """What a user asked of the API server, and the answer's code."""
    for event in plane.audit():
        target = event.get("objectRef", {})
        if event["user"]["username"] == user and "resource" in target:
            resource = "/".join(filter(None, (target["resource"], target.get("subresource"))))
            yield (target.get("apiGroup", ""), resource, event["verb"]), event["responseStatus"]["code"]


@pytest.mark.usefixtures("forget_installation")
@pytest.mark.parametrize("everywhere", [True, False], ids=["all namespaces", "one namespace"])
def test_the_rights_of_the_chart_are_enough_and_none_is_tried_in_vain(
    bare_control_plane: ControlPlane, system: str, robots: Place, tmp_path: Path, everywhere: bool
) -> None:
    watched = "" if everywhere else robots.namespace
    bare_control_plane.helm(system)(
        "install", RELEASE, str(CHART), *with_values({"watchNamespaces": [watched] if watched else []})
    )
    account = bare_control_plane.kubeconfig_of(system, OPERATOR)
    settings = {"POD_NAMESPACE": system, "WATCH_NAMESPACE": watched}
    operator = Operator.start(account, tmp_path / "operator.log", **settings)
    try:
        robots.create(ROBOT_OFFLOAD, talker())
        robots.applied("talker")
        robots.delete(DEPLOYMENT, "talker-agent")
        robots.there(DEPLOYMENT, "talker-agent")
        robots.change({"transport": {"type": "DiscoveryServer"}}, "talker")  # prunes what Zenoh needed
        robots.applied("talker")
        robots.change({"transport": {"type": "Zenoh", "expose": {"type": "NodePort"}}}, "talker")  # asks for nodes
        robots.applied("talker")
    finally:
        operator.stop()
    everything = list(asked(bare_control_plane, f"system:serviceaccount:{system}:{OPERATOR}"))
    refused = {right for right, code in everything if code == 403}
    assert refused <= ({("", "nodes", "list")} if not everywhere else set())
    declared = {
        (use.kind.group, "/".join(filter(None, (use.kind.plural, use.subresource))), verb)
        for use in USES
        for verb in use.verbs
    }
    used = {right for right, _ in everything}
    assert used <= declared
    assert used >= {("apps", "deployments", "patch"), ("", "services", "delete"), ("", "nodes", "list")}, (
        declared - used
    )
