"""The pods of a node with several of them: their names, their end, and who says how many there are."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.decide.plan import plan
from robot_offload.decide.scaling import followed
from robot_offload.errors import SpecError
from robot_offload.objects.labels import MOST_PODS
from robot_offload.objects.parent import Parent
from robot_offload.render import pool
from robot_offload.render.agent_names import handed_over
from robot_offload.render.children import children
from robot_offload.render.ros_names import command
from tests.contract.rule_examples import POOL, example_values
from tests.unit.operator.render.given import EVERY_ENDPOINT, facts
from tests.unit.specs import sample_with

RANGE = POOL | {"replicas": 2, "maxReplicas": 6}
SHOW = "import sys; print('\\n'.join(sys.argv[1:]))"


def deployment(node: dict[str, Any], **given: Any) -> dict[str, Any]:
    offload = parse_object(example_values("spec.nodes.2", node), "test.yaml")
    parent = Parent(offload, facts(endpoints=EVERY_ENDPOINT, robot_connected=True, **given))
    return next(it for it in children(parent) if it["metadata"]["name"].endswith("planner") and "spec" in it)


def container(node: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = deployment(node)["spec"]["template"]["spec"]["containers"][0]
    return found


def test_a_pod_starts_with_its_own_name_in_the_names_of_its_services() -> None:
    """The command line is run for real, by the program that the pod's arguments begin with."""
    words = pool.named(
        (sys.executable, "-c", SHOW, "a b", "$(x)", "-r", "/make_plan:=/offload/cloud/pod_this/make_plan")
    )
    done = subprocess.run(
        [sys.executable, *words[1:]],
        env={"PATH": os.environ["PATH"], pool.POD_VARIABLE: "a-planner-5d9f8-x2x9z"},
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert done.stdout.splitlines() == [
        "a b", "$(x)", "-r", "/make_plan:=/offload/cloud/pod_a_planner_5d9f8_x2x9z/make_plan"
    ]  # fmt: skip


def test_only_what_a_pool_serves_has_the_name_of_a_pod() -> None:
    lamp = {"name": "/lamp", "type": "std_srvs/srv/SetBool"}
    spec = sample_with("spec.nodes.2", POOL | {"uses": {"services": [lamp]}}).spec
    words = command(spec, spec.nodes[2], "cloud")
    assert "/make_plan:=/offload/cloud/pod_this/make_plan" in words
    assert "/lamp:=/offload/cloud/lamp" in words


def test_a_users_own_remapping_leads_to_the_name_of_the_pod() -> None:
    run = POOL["run"] | {"remap": {"plan": "/make_plan"}}
    spec = sample_with("spec.nodes.2", POOL | {"run": run}).spec
    assert "plan:=/offload/cloud/pod_this/make_plan" in command(spec, spec.nodes[2], "cloud")


def test_a_pod_has_the_time_that_its_longest_call_may_take() -> None:
    slow = {"name": "/slow", "type": "std_srvs/srv/Trigger", "timeout": "1m"}
    found = deployment(POOL | {"services": [*POOL["services"], slow]})["spec"]["template"]["spec"]
    environment = {it["name"]: it.get("value") for it in found["containers"][0]["env"]}
    assert float(environment[pool.WAIT_VARIABLE]) > 60
    assert found["terminationGracePeriodSeconds"] > float(environment[pool.WAIT_VARIABLE])
    assert found["containers"][0]["lifecycle"] == pool.pre_stop()


def test_the_agents_know_which_services_are_shared() -> None:
    for node, pooled in ((POOL, True), ({**POOL, "replicas": None}, False)):
        services = handed_over(sample_with("spec.nodes.2", node).spec)["service"]
        assert [it["pooled"] for it in services.values()] == [pooled]


def test_a_pool_has_as_many_pods_as_it_says_and_none_without_a_robot() -> None:
    assert deployment(POOL)["spec"]["replicas"] == 2
    assert deployment(POOL, nodes_wanted=False)["spec"]["replicas"] == 0
    assert deployment(POOL)["spec"]["strategy"]["type"] == "RollingUpdate"
    single = deployment({key: it for key, it in POOL.items() if key != "replicas"})
    assert (single["spec"]["replicas"], single["spec"]["strategy"]) == (1, {"type": "Recreate"})


def scaled(node: dict[str, Any], live: int, **given: Any) -> int:
    wanted = deployment(node, **given)
    found: int = followed(wanted, {**wanted, "spec": {**wanted["spec"], "replicas": live}})["spec"]["replicas"]
    return found


def test_what_an_autoscaler_asks_for_counts_within_the_range() -> None:
    assert [scaled(RANGE, live) for live in (1, 2, 5, 6, 40)] == [2, 2, 5, 6, 6]


def test_without_a_range_the_number_is_the_operators() -> None:
    assert scaled(POOL, 5) == 2
    assert MOST_PODS not in deployment(POOL)["metadata"].get("annotations", {})


def test_a_pool_that_had_no_pods_begins_with_the_least_number_and_one_without_a_robot_has_none() -> None:
    assert scaled(RANGE, 0) == 2
    assert scaled(RANGE, 5, nodes_wanted=False) == 0


def test_a_pool_that_an_autoscaler_changed_is_not_written_again() -> None:
    wanted = deployment(RANGE)
    uid = wanted["metadata"]["ownerReferences"][0]["uid"]
    (first,) = plan([wanted], {}, uid).applies
    (key,) = plan([wanted], {}, uid).touched
    live = {**first.manifest, "metadata": {**first.manifest["metadata"], "uid": "there"}}
    live["spec"] = {**live["spec"], "replicas": 5}
    assert not plan([wanted], {key: live}, uid).applies
    live["spec"] = {**live["spec"], "replicas": 9}
    (back,) = plan([wanted], {key: live}, uid).applies
    assert back.manifest["spec"]["replicas"] == 6


def test_a_client_in_the_cloud_cannot_call_a_pool() -> None:
    caller = POOL | {"name": "caller", "services": [], "replicas": None, "uses": {"services": POOL["services"]}}
    values = example_values("spec.nodes.2", POOL)
    values["spec"]["nodes"].append(caller)
    with pytest.raises(SpecError, match="only calls of clients on the robot are shared among pods"):
        parse_object(values, "test.yaml")
