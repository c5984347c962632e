"""Whatever is wrong in a file is told at once, a line each, and nothing else ever comes out."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from robot_offload.api.files import load
from robot_offload.api.v1alpha1.nodes import Output
from robot_offload.api.v1alpha1.parsing import findings_of, parse_object, parse_text
from robot_offload.errors import InputError, SpecError
from tests.unit.specs import SAMPLE, changed, sample


def problems(value: object) -> tuple[str, ...]:
    with pytest.raises(SpecError) as caught:
        parse_object(value, "f.yaml")
    return caught.value.lines


def test_all_problems_are_told_at_once() -> None:
    values = changed("spec.nodes.1.placement", "Both")
    values["spec"]["switching"]["lossTimeout"] = 90
    values["spec"]["robot"]["domainID"] = 233
    values["metadata"] = {}
    assert problems(values) == (
        "f.yaml: metadata.name: is missing (The robot's name: lower-case letters, digits and dashes, at most 63)",
        "f.yaml: spec.robot.domainID: must be at most 232, found the number 233",
        "f.yaml: spec.nodes[1].placement: 'Both' is not one of Robot, Cloud, Duplicated",
        "f.yaml: spec.switching.lossTimeout: is a duration and needs a unit: write 90ms or 90s",
    )


@pytest.mark.parametrize(
    ("path", "value", "problem"),
    [
        ("spec.topic", {}, "is not a known field; did you mean topics?"),
        (
            "spec.nodes.1.run.launch",
            "bringup.launch.py",
            "robot.launch.py includes your launch file as it is",
        ),
        ("spec.nodes.1.run.components", ["a::B"], "in the cloud one pod runs one node (docs/decisions/0016"),
        ("spec.switching.loss_timeout", "90ms", "is not a known field; did you mean lossTimeout?"),
        ("spec.robot.domainId", 1, "is not a known field; did you mean domainID?"),
        (
            "spec.nodes.1.outputs.0.zzz",
            1,
            "is not a known field; known here: deadline, frames, maxAge, mirror, qos, rate, shared",
        ),
        ("spec.topics.toCloud.0.qos.depht", 1, "is not a known field; did you mean depth?"),
        ("spec.transport.type", "zenoh", "DiscoveryServer, StaticPeers; did you mean Zenoh?"),
        ("spec.nodes.1.standby.cloud", "Cool", "'Cool' is not one of Cold, Warm, Hot; did you mean Cold?"),
        ("kind", "RobotOfload", "'RobotOfload' must be RobotOffload"),
        ("apiVersion", 1, "must be one of robotoffload.dev/v1alpha1, found the number 1"),
        ("spec.nodes.1.core", "yes", "must be true or false, found the text 'yes'"),
        ("spec.nodes.1.core", 1, "must be true or false, found the number 1"),
        ("spec.robot.domainID", "42", "must be a whole number, found the text '42'"),
        ("spec.robot.domainID", 1.5, "must be a whole number, found the number 1.5"),
        ("spec.robot.domainID", True, "must be a whole number, found true"),
        ("spec.topics.toCloud.0.maxRate", "fast", "must be a number, found the text 'fast'"),
        ("spec.topics.toCloud.0.maxRate", 0, "must be at least 0.05, found the number 0"),
        ("spec.topics.toCloud.0.maxRate", float("nan"), "must be a finite number, found the number nan"),
        ("spec.nodes", {}, "must be a list, found a mapping"),
        ("spec.nodes", [], "must have at least one entry"),
        ("spec.nodes.1", "controller", "must be a mapping, found the text 'controller'"),
        ("spec.driver", None, "must be a mapping, found nothing (remove the line or give a value)"),
        ("spec.nodes.1.run.command", "python3 x.py", "must be a list, found the text 'python3 x.py'"),
        ("spec.nodes.1.run.command", ["python3", ""], "must not be empty"),
        ("spec.nodes.1.run.parameters", {"a": None}, "a has no value; write one or leave the parameter out"),
        ("spec.nodes.1.run.parameters", {"a": []}, "a is an empty list"),
        ("spec.nodes.1.run.parameters", {"a": [1, "x"]}, "a is a list of different things"),
        ("spec.nodes.1.run.parameters", {"a": [[1]]}, "a is a list of lists"),
        ("spec.nodes.1.run.parameters", {"a b": 1}, "'a b' is not a parameter name"),
        ("spec.nodes.1.run.parameters", {"a": {"b": None}}, "b has no value"),
        ("spec.nodes.1.run.parameters", [1], "must be a mapping of parameter names to values"),
        ("spec.switching.heartbeatPeriod", "0s", "0s is out of range; it must be between 5ms and 1s"),
        ("spec.scale", {"idleTimeout": "10s"}, "10s is out of range; it must be 0s or between 30s and 168h"),
        ("spec.replicas", 2, "must be at most 1, found the number 2"),
        ("spec.nodes.1.resources", {"limits": {"cpu": "lots"}}, "'lots' is not a quantity; write for example 500m"),
        ("spec.nodes.1.resources", {"limits": {"cpu": 0.5}}, "0.5 is not a quantity; write for example 500m"),
        ("spec.nodes.1.nodeSelector", {"a b": "c"}, "'a b' is not the name of a label or annotation"),
        ("spec.nodes.1.nodeSelector", {"a": "b c"}, "'b c' is not a label's value"),
        ("spec.nodes.1.env", [{"name": "A-B"}], "'A-B' is not the name of an environment variable"),
        ("spec.nodes.1.run.parametersFrom", {"configMapKeyRef": {"name": "a"}}, "is missing (The key in it"),
        ("spec.transport.expose", {"host": "Edge.example:80"}, "is not a DNS name; write it in lower case"),
        ("spec.transport.expose", {"address": "edge"}, "'edge' must be the IP address of one machine, e.g. 192.0.2.10"),
        ("spec.cloud.imagePullSecrets", [{"name": "x"}] * 17, "has 17 entries; at most 16 fit"),
        ("spec.cloud.runAsUser", 0, "must be at least 1, found the number 0"),
        ("spec.nodes.1.run.command", ["x" * 5000], "is longer than 4096 characters"),
        ("spec.switching.latency.robotPeriod", "0ms", "0s is out of range; it must be between 1ms and 10s"),
    ],
)
def test_one_wrong_field_is_one_line_that_names_it(path: str, value: Any, problem: str) -> None:
    [line] = problems(changed(path, value))
    where, _, rest = line.removeprefix("f.yaml: ").partition(": ")
    assert where.split("[")[0].split(".")[0] == path.split(".", maxsplit=1)[0]
    assert problem in rest


def test_a_strange_field_name_stays_on_one_line() -> None:
    [line] = problems(changed("spec.robot", {"a\nb": 1}))
    assert line.startswith('f.yaml: spec.robot["a\\nb"]: is not a known field')


@pytest.mark.parametrize("value", [None, [], "text", 3, {}])
def test_something_else_than_a_resource_is_refused(value: object) -> None:
    assert problems(value)


def test_values_nested_without_end_are_refused() -> None:
    endless: dict[str, Any] = {}
    for _ in range(5000):
        endless = {"a": endless}
    assert problems(changed("spec.robot.rmw", endless)) == ("f.yaml: lists or mappings are nested too deeply",)


def test_the_operator_reads_an_object_as_the_api_server_keeps_it() -> None:
    stored = sample()
    stored["metadata"] |= {"uid": "1", "generation": 3, "managedFields": [{"manager": "kubectl"}]}
    stored["status"] = {"placement": "Cloud"}
    stored["spec"]["nodes"][1]["fromTheFuture"] = {"a": [1]}
    read = parse_object(stored, "stored", unknown="ignore")
    assert read == parse_object(sample(), "sample")
    assert len(problems(stored)) == 1, "the field from the future"
    stored["spec"]["nodes"][1]["placement"] = "Nowhere"
    with pytest.raises(SpecError) as caught:
        parse_object(stored, "stored", unknown="ignore")
    assert [finding.path for finding in caught.value.findings] == ["spec.nodes[1].placement"]


def test_a_double_keeps_its_type_although_kubernetes_drops_the_point() -> None:
    values = changed("spec.nodes.1.run.parameters", {"rate_hz": 20, "count": 3, "plugins": {"gain": 2, "all": [1, 2]}})
    values["spec"]["nodes"][1]["run"]["doubles"] = ["rate_hz", "plugins.gain", "plugins.all"]
    run = parse_object(values, "f.yaml").spec.nodes[1].run
    assert run is not None
    assert repr(run.parameters) == "{'rate_hz': 20.0, 'count': 3, 'plugins': {'gain': 2.0, 'all': (1.0, 2.0)}}"


def test_the_errors_of_a_part_are_told_with_the_fields_of_the_part() -> None:
    with pytest.raises(ValidationError) as caught:
        Output.model_validate({"topik": "/a"})
    assert [finding.line() for finding in findings_of(caught.value, Output)] == [
        "topic: is missing (The full name under which consumers know it, e.g. /cmd_vel)",
        "topik: is not a known field; did you mean topic?",
    ]


def test_yaml_errors_are_told_with_line_and_column() -> None:
    with pytest.raises(SpecError) as caught:
        parse_text("kind: RobotOffload\nkind: RobotOffload\n", "f.yaml")
    assert caught.value.lines == ("f.yaml: line 2, column 1: the key 'kind' is given twice; remove one",)


def test_a_file_is_loaded_and_its_name_stands_in_messages(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    good.write_text(SAMPLE)
    bad.write_text(SAMPLE.replace("kind: RobotOffload", "kind: Pod"))
    assert load(good).metadata.name == "wheelchair-7"
    with pytest.raises(SpecError, match=r"bad\.yaml: kind: 'Pod' must be RobotOffload"):
        load(bad)


def test_a_file_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"name: Stra\xdfe")
    for path, problem in (
        (tmp_path / "missing.yaml", "there is no such file"),
        (tmp_path, "is a folder"),
        (latin, "is not UTF-8 text"),
        ("nul\0.yaml", "cannot be read"),
    ):
        with pytest.raises(InputError, match=problem):
            load(path)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12)
    | st.sampled_from(["20ms", "0s", "Robot", "/scan", "", "none", "a/msg/B", "controller", "Zenoh", "DDSRouter"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in nested values, the root excluded."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = []
    for key, child in children:
        found += [(*path, key), *places(child, (*path, key))]
    return found


PLACES = places(sample())


@settings(max_examples=400, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(PLACES), st.sampled_from(["set", "remove", "add", "swap"]), ANYTHING), max_size=4
    )
)
def test_no_change_of_the_values_raises_anything_but_a_spec_error(
    edits: list[tuple[tuple[Any, ...], str, Any]],
) -> None:
    values = sample()
    for place, action, new in edits:
        target: Any = values
        try:
            for part in place[:-1]:
                target = target[part]
            if action == "remove":
                del target[place[-1]]
            elif action == "add":
                target[place[-1]]["extra"] = new
            elif action == "swap":
                target[place[-1]] = copy.deepcopy(values["spec"])
            else:
                target[place[-1]] = new
        except (KeyError, IndexError, TypeError):
            continue  # An earlier edit has removed the place.
    check_text_of_errors(lambda: parse_object(values, "f.yaml"))


@settings(max_examples=400, deadline=None)
@given(st.integers(), st.text(max_size=6))
def test_no_change_of_the_text_raises_anything_but_a_spec_error(seed: int, inserted: str) -> None:
    dice = random.Random(seed)
    text = SAMPLE
    for _ in range(dice.randint(1, 4)):
        start = dice.randrange(len(text))
        end = min(len(text), start + dice.choice([0, 0, 1, 2, 5, 30]))
        text = text[:start] + dice.choice([inserted, "", ":", "\n", "- ", "{", "*a", text[start:end] * 2]) + text[end:]
    check_text_of_errors(lambda: parse_text(text, "f.yaml"))


def check_text_of_errors(action: Callable[[], object]) -> None:
    lines: tuple[str, ...] = ("f.yaml: accepted",)
    try:
        action()
    except SpecError as error:
        lines = error.lines
    assert lines
    for line in lines:
        assert line.startswith("f.yaml: ")
        assert len(line.splitlines()) == 1


def test_an_object_as_the_cluster_keeps_it_is_read_like_the_file_it_came_from() -> None:
    kept = sample()
    kept["metadata"] |= {"uid": "1", "resourceVersion": "5", "managedFields": [{}], "finalizers": ["a.b/c"]}
    kept["status"] = {"placement": "Cloud"}
    assert parse_object(kept, "kept").spec == parse_object(sample(), "file").spec


@pytest.mark.parametrize("field", ["finalizers", "ownerReferences", "resourceVersion"])
def test_what_a_cluster_writes_does_not_belong_in_a_file(field: str) -> None:
    with pytest.raises(SpecError) as caught:
        parse_object(changed(f"metadata.{field}", []), "f.yaml")
    [finding] = caught.value.findings
    assert (finding.path, finding.reason) == (f"metadata.{field}", "ServerWritten")
    assert "remove it" in finding.message
