"""A change rolls exactly the pods that read what has changed; what changes while they run rolls none."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Facts
from tests.unit.operator.render.given import EVERY_ENDPOINT, ROUTER, facts, offload, pods, rendered

AGENT = "Deployment/wheelchair-7-agent"
CONTROLLER = "Deployment/wheelchair-7-controller"
PLANNER = "Deployment/wheelchair-7-planner"
ROUTER_POD = "Deployment/wheelchair-7-router"
SERVERS = {"StatefulSet/wheelchair-7-discovery-0", "StatefulSet/wheelchair-7-discovery-1"}
NODES = {CONTROLLER, PLANNER}
EVERY_POD = {AGENT, *NODES, *SERVERS}
BASE = offload()


def rolled(before: RobotOffload, after: RobotOffload, old: Facts | None = None, new: Facts | None = None) -> set[str]:
    """The workloads whose pods Kubernetes replaces; those that come or go are not among them."""
    earlier, later = pods(rendered(before, old or facts())), pods(rendered(after, new or old or facts()))
    return {name for name in earlier.keys() & later.keys() if earlier[name] != later[name]}


RUN_TIME = {
    "switching.mode": "Observe",
    "switching.pin": "Cloud",
    "switching.prefer": "Robot",
    "switching.lossTimeout": "70ms",
    "switching.lease": "300ms",
    "switching.maxCommandAge": "160ms",
    "switching.latency": {"robotPeriod": "60ms", "cloudPeriod": "30ms", "tolerance": "20ms"},
    "switching.minDwell": "2s",
    "switching.holdDown": {"initial": "2s", "max": "10s", "flapWindow": "4s"},
    "switching.activationDeadline": "300ms",
    "switching.maxClockOffset": "25ms",
    "topics.toCloud.0.maxAge": "250ms",
    "topics.toCloud.0.maxRate": 10,
    "replicas": 0,
    "scale": {"idleTimeout": "5m"},
}


@pytest.mark.parametrize("path", RUN_TIME)
def test_what_changes_at_run_time_rolls_nothing(path: str) -> None:
    changed = offload({path: RUN_TIME[path]})
    assert changed != BASE
    assert rolled(BASE, changed, facts(), facts(generation=4)) == set()


@pytest.mark.parametrize("path", [path for path in RUN_TIME if path.split(".")[0] in ("switching", "topics")])
def test_what_changes_at_run_time_is_in_the_watched_settings(path: str) -> None:
    name = "ConfigMap/wheelchair-7-settings"
    assert rendered(BASE)[name]["data"] != rendered(offload({path: RUN_TIME[path]}))[name]["data"]


START = {
    "switching.heartbeatPeriod": ("25ms", {AGENT}),
    "switching.strict": (True, {AGENT}),
    "driver": ({"inhibitService": "/stop"}, {AGENT}),
    "topics.toCloud.0.name": ("/scan_front", {AGENT}),
    "topics.toCloud.1.latched": (True, {AGENT}),
    "nodes.1.core": (False, {AGENT}),
    "nodes.1.outputs": ([{"topic": "/cmd_vel", "rate": 10}], {AGENT}),
    "nodes.1.image": ("registry.example/controller:2", {CONTROLLER}),
    "nodes.1.run.cloudParameters": ({"rate_hz": 40.0}, {CONTROLLER, AGENT}),  # names say what may differ
    "nodes.1.run.cloudParameters.rate_hz": (40.0, {CONTROLLER}),
    "nodes.1.run.remap": ({"cmd_vel_nav": "/cmd_vel", "scan": "/scan_front"}, {CONTROLLER}),
    "nodes.1.env": ([{"name": "RCUTILS_COLORIZED_OUTPUT", "value": "0"}], {CONTROLLER}),
    "nodes.2.resources": ({"limits": {"nvidia.com/gpu": 1}}, {PLANNER}),
    "nodes.2.runtimeClassName": ("nvidia", {PLANNER}),
    "cloud.domainID": (44, {AGENT, *NODES}),
    "cloud.runAsUser": (2000, EVERY_POD),
    "cloud.nodeSelector": ({"pool": "edge"}, EVERY_POD),
    "robot.namespace": ("/chair", {AGENT, *NODES}),
    "robot.rosDistro": ("humble", set()),
    "nodes.0.run.command": (["python3", "other.py"], set()),
    "transport.zenoh.pulsePort": (7450, set()),
    "transport.expose": ({"type": "NodePort", "host": "edge.example"}, set()),
}


@pytest.mark.parametrize("path", START)
def test_what_is_read_at_the_start_rolls_exactly_its_readers(path: str) -> None:
    value, readers = START[path]
    assert rolled(BASE, offload({path: value})) == readers


def test_the_order_in_which_values_are_written_is_no_change() -> None:
    parameters = {"rate_hz": 50.0, "max_speed": 0.9}
    turned = dict(reversed(parameters.items()))
    one, other = (offload({"nodes.1.run.cloudParameters": each}) for each in (parameters, turned))
    assert rolled(one, other) == set()


def test_a_renewed_certificate_rolls_the_agent_alone() -> None:
    assert rolled(BASE, BASE, facts(), facts(certificate_hash="c2")) == {AGENT}


def test_a_renewed_certificate_rolls_the_router_where_it_is_the_one_that_has_it() -> None:
    resource = offload(transport={"type": "DDSRouter"})
    old, new = (facts(endpoints=(ROUTER,), certificate_hash=one) for one in ("c1", "c2"))
    assert rolled(resource, resource, old, new) == {ROUTER_POD}


def test_a_new_address_of_the_cloud_rolls_nobody() -> None:
    moved = facts(endpoints=tuple(type(one)(one.purpose, one.protocol, "198.51.100.1", 9) for one in EVERY_ENDPOINT))
    known = facts(endpoints=EVERY_ENDPOINT)
    for resource in (BASE, offload(transport={"type": "DDSRouter"})):
        assert rolled(resource, resource, known, moved) == set()


def test_a_changed_parameter_file_rolls_the_node_that_reads_it() -> None:
    from_file = {"configMapKeyRef": {"name": "nav", "key": "nav.yaml"}}
    resource = offload({"nodes.1.run.parametersFrom": from_file})
    old, new = (facts(user_config_hashes={"nav/nav.yaml": one, "other/x": one}) for one in ("1", "2"))
    assert rolled(resource, resource, old, new) == {CONTROLLER}


@given(wanted=st.booleans(), connected=st.booleans(), generation=st.integers(1, 9))
def test_the_robot_coming_and_going_rolls_nothing(wanted: bool, connected: bool, generation: int) -> None:
    now = facts(nodes_wanted=wanted, robot_connected=connected, generation=generation)
    assert rolled(BASE, BASE, facts(), now) == set()


def test_a_node_more_rolls_the_agent_that_has_to_know_it_and_no_other_node() -> None:
    more: dict[str, Any] = {"name": "mapper", "placement": "Cloud", "image": "i", "run": {"command": ["m"]}}
    assert rolled(BASE, offload({"nodes": [*_nodes(), more]})) == {AGENT}


def _nodes() -> list[dict[str, Any]]:
    values = BASE.model_dump(mode="json", by_alias=True, exclude_unset=True)
    nodes: list[dict[str, Any]] = values["spec"]["nodes"]
    return nodes
