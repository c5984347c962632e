"""Our CRD on a real API server: it refuses what the models refuse, takes what they take, and explains itself."""

from __future__ import annotations

import asyncio
import json
import ssl
from collections.abc import Awaitable, Callable
from typing import Any

import aiohttp
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robot_offload.api.strict_yaml import parse, thaw
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, RULES
from robot_offload.errors import SpecError
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.contract.hostile import HARMLESS, HOSTILE
from tests.contract.rule_examples import BROKEN, KEPT, example_values
from tests.contract.test_crd import PLACES
from tests.unit.specs import MINIMAL, changed, sample

pytestmark = [pytest.mark.api, pytest.mark.core]

Create = Callable[[Any], Awaitable[tuple[int, dict[str, Any]]]]
# One field each: what the models refuse about it, the API server refuses as well, by pattern, size or its own rule.
WRONG_FIELDS: tuple[tuple[str, Any], ...] = (
    ("metadata.name", "with.dot"),
    ("metadata.name", "x" * 64),
    ("spec.unknown", 1),
    ("spec.nodes.1.run.unknown", 1),
    ("spec.nodes", []),
    ("spec.nodes.0.name", "controller"),
    ("spec.nodes.0.name", "guardian"),
    ("spec.nodes.0.name", "remote_base"),
    ("spec.nodes.0.name", "a/b"),
    ("spec.topics.toCloud.1.name", "/scan"),
    ("spec.topics.toCloud.1.name", "/offload/x"),
    ("spec.topics.toCloud.1.name", "/network_status"),
    ("spec.topics.toCloud.1.name", "/a__b"),
    ("spec.topics.toCloud.1.name", "odom"),
    ("spec.nodes.1.outputs.1", {"topic": "/cmd_vel"}),
    ("spec.robot.namespace", "/a__b"),
    ("spec.robot.domainID", 233),
    ("spec.robot.rosDistro", "noetic"),
    ("spec.switching.heartbeatPeriod", "20"),
    ("spec.switching.heartbeatPeriod", "4ms"),
    ("spec.switching.heartbeatPeriod", 20),
    ("spec.scale", {"idleTimeout": "29s"}),
    ("spec.scale", {"idleTimeout": "169h"}),
    ("spec.replicas", 2),
    ("spec.cloud.discoveryServers", 5),
    ("spec.cloud.runAsUser", 0),
    ("spec.nodes.1.resources", {"limits": {"memory": "much"}}),
    ("spec.nodes.1.env", [{"name": "A"}, {"name": "A"}]),
    ("spec.transport.type", "ROS"),
    ("spec.transport.expose", {"host": "Edge:80"}),
)


@pytest.fixture
def judged(control_plane: ControlPlane, namespace: str) -> Callable[[Any], tuple[int, str]]:
    """Sends an object with strict validation and without keeping it; gives the status code and the message."""

    async def create(values: Any) -> tuple[int, str]:
        path = f"/apis/robotoffload.dev/v1alpha1/namespaces/{namespace}/robotoffloads"
        trust = ssl.create_default_context(cafile=str(control_plane.ca_file))
        async with (
            aiohttp.ClientSession(headers={"Authorization": f"Bearer {control_plane.token}"}) as session,
            session.post(
                f"{control_plane.url}{path}?dryRun=All&fieldValidation=Strict", json=values, ssl=trust
            ) as answer,
        ):
            return answer.status, json.dumps(await answer.json())

    return lambda values: asyncio.run(create(values))


def test_the_sample_and_the_smallest_are_taken(judged: Callable[[Any], tuple[int, str]]) -> None:
    smallest = thaw(parse(MINIMAL))
    assert isinstance(smallest, dict)
    smallest["spec"]["nodes"][0]["run"] = {"command": ["talker"]}  # what a cluster needs beyond a single machine
    for values in (sample(), smallest):
        status, said = judged(values)
        assert status == 201, said


def test_what_breaks_a_rule_is_refused_with_the_words_of_the_rule(judged: Callable[[Any], tuple[int, str]]) -> None:
    for example in BROKEN:
        status, said = judged(example_values(example.path, example.value))
        messages = [rule.message for rule in RULES if (rule.path, rule.reason) == example.rule]
        assert status == 422, (example, said)
        assert any(message in said for message in messages), (example, said)


def test_every_rule_has_refused_something(judged: Callable[[Any], tuple[int, str]]) -> None:
    said = " ".join(judged(example_values(example.path, example.value))[1] for example in BROKEN)
    assert [rule.message for rule in RULES if rule.message not in said] == []


@pytest.mark.parametrize("part", [0, 1])
def test_what_keeps_the_rules_is_taken(judged: Callable[[Any], tuple[int, str]], part: int) -> None:
    for path, value in KEPT[part::2]:
        status, said = judged(example_values(path, value))
        assert status == 201, (path, value, said)


def test_a_wrong_field_is_refused_by_both(judged: Callable[[Any], tuple[int, str]]) -> None:
    for path, value in WRONG_FIELDS:
        values = changed(path, value)
        status, said = judged(values)
        assert status in (400, 422), (path, value, said)
        with pytest.raises(SpecError):
            parse_object(values, "f.yaml", rules=CLUSTER_CHECKS)


def test_what_is_hostile_is_refused_when_it_is_written(judged: Callable[[Any], tuple[int, str]]) -> None:
    answers = {hostile.name: judged(hostile.values) for hostile in HOSTILE}
    assert [hostile.name for hostile in HOSTILE if hostile.by_server != (answers[hostile.name][0] == 422)] == []
    assert [(path, value) for path, value in HARMLESS if judged(example_values(path, value))[0] != 201] == []


# A value for a field, right for some and wrong for most. No null: the API server drops it, the models ask for a value.
VALUES = st.sampled_from(
    ["20ms", "0s", "1h", "500m", "Robot", "Cold", "/scan", "/a__b", "", "none", "a/msg/B", "Zenoh", "DDSRouter",
     "Exists", "StaticPeers", "x" * 64, "x" * 300, "a.b", "A", "a_b", "1.2.3.4", "::1", "remote_x", "guardian", "a\n",
     "a b", 0, 1, -1, 2, 300, 70_000, 0.01, 0.05, 1001, [], {}, True, False]
)  # fmt: skip
# What only the operator judges: keys of mappings, the form of parameters, and these reasons.
OPERATOR_ONLY = {"DuplicateOutput", "AlsoAnOutput", "AmbiguousTopic", "DuplicateVariable"}


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(PLACES), VALUES)
def test_any_change_of_one_field_is_judged_alike(
    judged: Callable[[Any], tuple[int, str]], path: str, value: Any
) -> None:
    values = changed(path, value)
    try:
        parse_object(values, "f.yaml", rules=CLUSTER_CHECKS)
        taken = True
    except SpecError as error:
        taken = {finding.reason for finding in error.findings} <= OPERATOR_ONLY
    status, said = judged(values)
    assert (status == 201) == taken, said


DURATIONS = st.builds(lambda number, unit: f"{number}{unit}", st.integers(0, 400), st.sampled_from(["ms", "ms", "s"]))
SWITCHING = st.fixed_dictionaries(
    {},
    optional={
        "heartbeatPeriod": DURATIONS,
        "lossTimeout": DURATIONS,
        "lease": DURATIONS,
        "maxCommandAge": DURATIONS,
        "latency": st.fixed_dictionaries({}, optional={"robotPeriod": DURATIONS, "cloudPeriod": DURATIONS}),
        "holdDown": st.fixed_dictionaries({}, optional={"initial": DURATIONS, "max": DURATIONS}),
    },
)


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(SWITCHING)
def test_any_switching_block_is_judged_alike(judged: Callable[[Any], tuple[int, str]], switching: Any) -> None:
    values = changed("spec.switching", switching)
    try:
        parse_object(values, "f.yaml", rules=CLUSTER_CHECKS)
        expected = 201
    except SpecError:
        expected = 422
    status, said = judged(values)
    assert status == expected, said


def test_an_object_with_a_field_of_a_newer_version_is_read_without_it(kubectl: Kubectl) -> None:
    kubectl.apply(sample())
    stored = kubectl.json("get", "roff", "wheelchair-7")
    stored["spec"]["robot"]["fromTheFuture"] = True
    stored["status"] = {"placement": "Cloud"}
    read = parse_object(stored, "stored", unknown="ignore", rules=CLUSTER_CHECKS)
    assert read.spec == parse_object(sample(), "sample").spec
    run = read.spec.nodes[1].run
    assert run is not None
    assert isinstance(run.parameters["rate_hz"], float), "Kubernetes keeps 20.0 as 20"


def test_explain_reads_like_documentation(kubectl: Kubectl) -> None:
    said = " ".join(kubectl("explain", "roff.spec.switching").split())
    assert "When and how the acting side changes." in said
    assert "How long the cloud may go on without hearing the robot." in said
    every = kubectl("explain", "roff.spec", "--recursive")
    assert "parametersFrom" in every
    assert "<no description>" not in kubectl("explain", "roff.spec.nodes.outputs")


def test_get_shows_what_a_person_wants_to_know(kubectl: Kubectl) -> None:
    kubectl.apply(sample())
    status = {
        "placement": "Cloud",
        "placementReason": "LinkGood",
        "nodesReady": "2/2",
        "robot": {"connected": True, "since": "2026-01-01T00:00:00Z"},
        "conditions": [
            {"type": "Ready", "status": "True", "reason": "Ready", "lastTransitionTime": "2026-01-01T00:00:00Z"}
        ],
    }
    kubectl(
        "patch", "roff", "wheelchair-7", "--subresource=status", "--type=merge", "-p", json.dumps({"status": status})
    )
    head, row = kubectl("get", "roff", "-o", "wide").splitlines()
    assert head.split() == ["NAME", "PLACEMENT", "REASON", "ROBOT", "READY", "NODES", "AGE", "SINCE", "TRANSPORT"]
    assert row.split()[:6] == ["wheelchair-7", "Cloud", "LinkGood", "true", "True", "2/2"]
    assert row.split()[-1] == "Zenoh"


def test_scale_turns_the_cloud_side_off_and_on(kubectl: Kubectl) -> None:
    kubectl.apply(sample())
    kubectl("scale", "roff", "wheelchair-7", "--replicas=0")
    assert kubectl.json("get", "roff", "wheelchair-7")["spec"]["replicas"] == 0
    assert "spec.replicas" in kubectl.refuses("scale", "roff", "wheelchair-7", "--replicas=2")
    kubectl("scale", "roff", "wheelchair-7", "--replicas=1")
    assert kubectl.json("get", "roff", "wheelchair-7")["spec"]["replicas"] == 1
