"""What users and administrators say about pods in Kubernetes' own words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.pod_spec import CONTAINERS, VOLUMES
from robot_offload.errors import SpecError
from robot_offload.objects.facts import Facts
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from tests.unit.operator.decide.worlds import FACTS
from tests.unit.specs import sample

SHM = {
    "volumes": [{"name": "shm", "emptyDir": {"medium": "Memory", "sizeLimit": "1Gi"}}],
    "containers": [{"name": "node", "volumeMounts": [{"name": "shm", "mountPath": "/dev/shm"}]}],
}
LIMITS = {"containers": [{"name": name, "resources": {"limits": {"cpu": "1"}}} for name in CONTAINERS]}


def pods(spec: dict[str, Any], facts: Facts = FACTS) -> dict[str, dict[str, Any]]:
    """The specifications of all pods, by the names of their workloads."""
    values = sample()
    nodes = values["spec"]["nodes"]
    values["spec"] |= {key: value for key, value in spec.items() if key != "planner"}
    values["spec"]["nodes"] = [*nodes[:2], {**nodes[2], **spec.get("planner", {})}]
    made = children(Parent(parse_object(values, "w.yaml"), facts))
    return {
        one["metadata"]["name"]: one["spec"]["template"]["spec"]
        for one in made
        if one["kind"] in ("Deployment", "StatefulSet")
    }


def refused(part: Any) -> str:
    with pytest.raises(SpecError) as caught:
        pods({"cloud": {"podSpec": part}})
    return str(caught.value)


def test_every_container_of_ours_can_be_given_limits_in_one_place() -> None:
    for spec, facts in (({"cloud": {"podSpec": LIMITS}}, FACTS), ({}, replace(FACTS, pod_spec=LIMITS))):
        for name, pod in pods(spec, facts).items():
            assert all(each["resources"]["limits"]["cpu"] == "1" for each in pod["containers"]), name


def test_what_is_not_named_of_resources_stays_as_it_was() -> None:
    agent = pods({"cloud": {"podSpec": LIMITS}})["wheelchair-7-agent"]["containers"][0]
    assert agent["resources"]["requests"] == {"cpu": "200m", "memory": "160Mi"}
    assert agent["resources"]["limits"] == {"cpu": "1", "memory": "768Mi"}


def test_the_more_particular_word_counts() -> None:
    facts = replace(FACTS, pod_spec={"priorityClassName": "robots", "schedulerName": "fleet"})
    found = pods(
        {"cloud": {"podSpec": {"priorityClassName": "ward"}}, "planner": {"podSpec": {"priorityClassName": "low"}}},
        facts,
    )
    assert found["wheelchair-7-agent"]["priorityClassName"] == "ward"
    assert found["wheelchair-7-planner"]["priorityClassName"] == "low"
    assert {pod["schedulerName"] for pod in found.values()} == {"fleet"}


def test_one_node_can_have_shared_memory_and_a_place_of_its_own() -> None:
    taint = {"key": "gpu", "operator": "Exists"}
    found = pods({"planner": {"podSpec": {**SHM, "tolerations": [taint]}}})
    pod = found.pop("wheelchair-7-planner")
    assert {"name": "shm", "mountPath": "/dev/shm"} in pod["containers"][0]["volumeMounts"]
    assert SHM["volumes"][0] in pod["volumes"]
    assert pod["tolerations"] == [taint]
    assert not any("shm" in str(other) or "tolerations" in other for other in found.values())


def test_tolerations_of_all_and_of_one_add_up() -> None:
    a, b = {"key": "a", "operator": "Exists"}, {"key": "b", "operator": "Exists"}
    found = pods({"cloud": {"tolerations": [a]}, "planner": {"podSpec": {"tolerations": [b]}}})
    assert [each["key"] for each in found["wheelchair-7-planner"]["tolerations"]] == ["a", "b"]


def test_pull_secrets_of_the_platform_reach_every_pod() -> None:
    facts = replace(FACTS, pull_secrets=("registry", "own"))
    for pod in pods({"cloud": {"imagePullSecrets": [{"name": "own"}]}}, facts).values():
        assert [each["name"] for each in pod["imagePullSecrets"]] == ["own", "registry"]


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"hostNetwork": True}, "hostNetwork is not a field that can be set here"),
        ({"serviceAccountName": "admin"}, "serviceAccountName is not"),
        ({"initContainers": []}, "initContainers is not"),
        ({"volumes": [{"name": "etc", "hostPath": {"path": "/etc"}}]}, "volumes[etc].hostPath is not"),
        ({"volumes": [{"name": "keys", "secret": {"secretName": "k"}}]}, "volumes[keys].secret is not"),
        ({"volumes": [{"name": "token", "emptyDir": {}}]}, "token is the name of a volume of ours"),
        ({"containers": [{"name": "evil"}]}, "there is no container 'evil'"),
        ({"containers": [{"name": "agent", "image": "evil"}]}, "containers[agent].image is not"),
        ({"containers": [{"name": "agent", "command": ["sh"]}]}, "containers[agent].command is not"),
        (
            {"containers": [{"name": "agent", "volumeMounts": [{"name": "token", "mountPath": "/x"}]}]},
            "'token' is not among the volumes of this block",
        ),
        (
            {**SHM, "containers": [{"name": "node", "volumeMounts": [{"name": "shm", "mountPath": "/tmp/x"}]}]},
            "'/tmp/x' would hide files of ours",
        ),
        ({"containers": {"agent": {}}}, "containers must be a list of mappings"),
        ([], "must be a mapping"),
        ({"tolerations": "all"}, "tolerations must be a list of mappings"),
    ],
)
def test_what_would_give_a_pod_more_rights_is_refused_by_name(part: Any, said: str) -> None:
    text = refused(part)
    assert "spec.cloud.podSpec" in text
    assert said in text


def test_all_names_of_ours_are_known() -> None:
    for pod in pods({}).values():
        assert {each["name"] for each in pod["containers"]} <= set(CONTAINERS)
        assert {each["name"] for each in pod["volumes"]} <= set(VOLUMES)
