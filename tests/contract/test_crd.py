"""CRD = models: the same fields, defaults, limits and words; each rule in CEL is a check as well."""

from __future__ import annotations

import copy
import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload.api.crd import crd, part_at, schema
from robot_offload.api.strict_yaml import freeze, parse, thaw
from robot_offload.api.v1alpha1.model import Model, yaml_name
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, RULES, Check, not_yet
from robot_offload.api.v1alpha1.status import RobotOffloadStatus
from robot_offload.errors import SpecError
from scripts.generate.files import CRD_FILE, CRD_LINK, generated_files
from scripts.generate.main import OutOfDateError, main, run
from scripts.generate.node_graph import GRAPH_FILE
from scripts.generate.rooms import ARCHITECTURE_FILE
from tests.contract.rule_examples import BROKEN, BUILD, KEPT, Example, example_values
from tests.contract.rule_examples import WORDS as WORDS_TO_COME
from tests.contract.structural import KNOWN_KEYS, defaulted, problems
from tests.unit.specs import MINIMAL, changed, sample

ROOT = Path(__file__).parents[2]
SCHEMA = schema()
SPEC = SCHEMA["properties"]["spec"]


def parts(part: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    yield path, part
    for name, field in part.get("properties", {}).items():
        yield from parts(field, f"{path}.{name}" if path else name)
    if "items" in part:
        yield from parts(part["items"], f"{path}[]")
    if "additionalProperties" in part:
        yield from parts(part["additionalProperties"], f"{path}{{}}")


PARTS = dict(parts(SPEC, "spec")) | dict(parts(SCHEMA["properties"]["status"], "status"))


def bare(annotation: Any) -> tuple[Any, bool]:
    """An annotation without Annotated[...] and without `| None`, and whether None was allowed."""
    optional = False
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif get_origin(annotation) in (Union, UnionType) and NoneType in get_args(annotation):
            [annotation] = [choice for choice in get_args(annotation) if choice is not NoneType]
            optional = True
        else:
            return annotation, optional


def fields(model: type[Model], path: str) -> Iterator[tuple[str, Any, Any, bool]]:
    """(path, pydantic's field, plain type, whether it may be null) of every field below a model."""
    for name, field in model.model_fields.items():
        here = f"{path}.{yaml_name(name)}"
        kind, optional = bare(field.annotation)
        yield here, field, kind, optional
        inner = kind
        if get_origin(kind) is tuple:
            here, (inner, _) = f"{here}[]", bare(get_args(kind)[0])
        if isinstance(inner, type) and issubclass(inner, Model):
            yield from fields(inner, here)


FIELDS = [*fields(RobotOffloadSpec, "spec"), *fields(RobotOffloadStatus, "status")]


def test_the_committed_files_are_what_the_models_say() -> None:
    run(ROOT, check=True)


def test_the_manifests_have_the_charts_definition() -> None:
    assert (ROOT / CRD_LINK).resolve() == (ROOT / CRD_FILE).resolve()


def test_a_file_that_is_out_of_date_is_told_with_the_difference(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "operator/robot_offload/api").mkdir(parents=True)
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / ARCHITECTURE_FILE, tmp_path / ARCHITECTURE_FILE)
    shutil.copytree((ROOT / GRAPH_FILE).parent, (tmp_path / GRAPH_FILE).parent)
    assert main(["--root", str(tmp_path)]) == 0
    assert main(["--root", str(tmp_path), "--check"]) == 0
    written = tmp_path / CRD_FILE
    assert written.read_text() == generated_files()[CRD_FILE]
    written.write_text(written.read_text().replace("maximum: 232", "maximum: 233"))
    with pytest.raises(OutOfDateError, match="maximum: 233"):
        run(tmp_path, check=True)
    assert main(["--root", str(tmp_path / "operator")]) == 2
    assert "is not the repository" in capsys.readouterr().err


def test_the_written_crd_reads_back_as_the_same_object() -> None:
    assert thaw(parse(generated_files()[CRD_FILE])) == json.loads(json.dumps(crd()))


def test_the_crd_has_every_field_of_the_models_and_no_other() -> None:
    of_crd = {path for path in PARTS if not path.endswith(("[]", "{}"))} - {"spec", "status"}
    assert of_crd == {path for path, *_ in FIELDS}


@pytest.mark.parametrize(("path", "field", "kind", "optional"), [pytest.param(*it, id=it[0]) for it in FIELDS])
def test_a_field_of_the_crd_is_the_field_of_the_model(path: str, field: Any, kind: Any, optional: bool) -> None:
    part = PARTS[path]
    parent = PARTS[path.rpartition(".")[0]]
    assert (path.rpartition(".")[2] in parent.get("required", ())) == field.is_required()
    assert part.get("nullable", False) == (optional and field.default is not None)
    if get_origin(kind) is Literal:
        assert tuple(part["enum"]) == get_args(kind)
    if get_origin(kind) is tuple:
        assert part["type"] == "array"
    assert part["description"].startswith(field.description.removesuffix("."))


@pytest.mark.parametrize("path", list(PARTS))
def test_every_part_of_the_schema_is_structural_bounded_and_described(path: str) -> None:
    part = PARTS[path]
    assert set(part) <= KNOWN_KEYS
    if "x-kubernetes-int-or-string" in part:
        assert part["maxLength"]
        return
    kind = part["type"]
    if not path.endswith("{}") and kind != "string":
        assert part.get("description") or path.endswith("[]")
    if kind == "array":
        assert part["maxItems"]
    if kind == "string":
        assert "enum" in part or part["maxLength"]
    if "additionalProperties" in part:
        assert part["maxProperties"]
        assert "properties" not in part
    for key in part.get("x-kubernetes-list-map-keys", ()):
        assert key in part["items"]["required"]


@pytest.mark.parametrize("path", [path for path, part in PARTS.items() if "from" in part.get("description", "")])
def test_a_range_in_words_is_the_range_that_holds(path: str) -> None:
    part = PARTS[path]
    stated = re.search(r"from ([0-9.]+[a-z]*) to ([0-9.]+[a-z]*[0-9a-z]*)", part["description"], re.IGNORECASE)
    if stated is None:
        return
    if part["type"] == "string":
        said = f"between {stated[1]} and {stated[2].rstrip('.')}"
        assert any(said in rule["message"] for rule in part["x-kubernetes-validations"])
    else:
        assert (float(stated[1]), float(stated[2].rstrip("."))) == (part["minimum"], part["maximum"])


def test_the_api_server_fills_in_what_the_models_would() -> None:
    minimal = thaw(parse(MINIMAL))
    filled = defaulted(minimal, SCHEMA)
    assert filled["spec"]["switching"]["latency"] == {"robotPeriod": "50ms", "cloudPeriod": "20ms", "tolerance": "30ms"}
    assert parse_object(filled, "filled").model_dump() == parse_object(minimal, "minimal").model_dump()
    models = parse_object(minimal, "minimal").model_dump(mode="json")
    for path, part in PARTS.items():
        if path.startswith("spec.") and "default" in part and "[]" not in path and "properties" not in part:
            value = models
            for name in path.split("."):
                value = None if value is None else value[name]
            assert value == part["default"] or "issuerRef" in path or "cloud.registry" in path, path


def test_the_api_server_fills_in_nothing_that_changes_the_meaning() -> None:
    values = changed("spec.transport", {"type": "DDSRouter"})
    del values["spec"]["nodes"][0]["run"]
    filled = defaulted(values, SCHEMA)
    assert set(filled["spec"]["transport"]) == {"type"}
    assert "standby" not in filled["spec"]["nodes"][0]
    parse_object(filled, "filled", rules=CLUSTER_CHECKS)


def test_the_status_has_no_defaults() -> None:
    assert not [path for path, part in PARTS.items() if path.startswith("status") and "default" in part]


def test_a_status_that_the_operator_writes_fits_the_schema() -> None:
    status = RobotOffloadStatus.model_validate(
        freeze(
            {
                "observedGeneration": 2,
                "conditions": [
                    {
                        "type": "Ready",
                        "status": "True",
                        "reason": "Ready",
                        "message": "All is well",
                        "observedGeneration": 2,
                        "lastTransitionTime": "2026-01-01T00:00:00Z",
                    }
                ],
                "placement": "Cloud",
                "robot": {"connected": True, "since": "2026-01-01T00:00:00Z", "generation": 2},
                "endpoints": [{"purpose": "pulse", "protocol": "UDP", "host": "192.0.2.1", "port": 7447}],
                "nodes": [{"name": "talker", "workload": "talker-talker", "replicas": 1, "ready": True}],
            }
        )
    ).model_dump(mode="json", exclude_none=True)
    assert not list(problems(status, SCHEMA["properties"]["status"]))


# -- rules between fields ---------------------------------------------------------------------------------------------


def refused(values: object, rules: Sequence[Check] = CLUSTER_CHECKS) -> list[tuple[str, str]]:
    """(path, reason) of what the models and checks of a cluster find."""
    try:
        parse_object(values, "f.yaml", rules=rules)
    except SpecError as error:
        return [(finding.path, finding.reason) for finding in error.findings]
    return []


@pytest.mark.parametrize("example", BROKEN, ids=lambda example: example.name)
def test_what_breaks_a_rule_of_the_crd_is_refused_by_a_check_for_the_same_reason(example: Example) -> None:
    found = refused(example_values(example.path, example.value))
    path, reason = example.rule
    shape = path.replace("[]", "")
    assert any(re.sub(r"\[\d+\]", "", where).startswith(shape) for where, why in found if why == reason)


@pytest.mark.parametrize(("path", "value"), KEPT, ids=lambda it: str(it)[:60])
def test_what_keeps_the_rules_is_taken(path: str, value: Any) -> None:
    assert not refused(example_values(path, value))


@pytest.mark.parametrize(("path", "value"), WORDS_TO_COME, ids=lambda it: str(it)[:60])
def test_what_keeps_the_rules_of_a_word_is_refused_only_while_the_word_is_not_built(path: str, value: Any) -> None:
    values = example_values(path, value)
    assert {reason for _, reason in refused(values)} <= {not_yet.REASON}
    assert not list(problems(values["spec"], SPEC))


def test_every_rule_of_the_crd_stands_in_it_and_has_an_example() -> None:
    for rule in RULES:
        assert rule.schema() in part_at(SCHEMA, rule.path)["x-kubernetes-validations"]
        assert not rule.field or f"{rule.path}.{rule.field}" in PARTS
    assert {(rule.path, rule.reason) for rule in RULES} == {example.rule for example in BROKEN}


# -- single fields: whatever is changed, both say yes or both say no --------------------------------------------------

# What the API server cannot say: the form of parameters and of the keys of mappings, the order of a duration's units.
ONLY_THE_OPERATOR = re.compile(
    r"\.(parameters|cloudParameters|remap|labels|annotations|nodeSelector|limits|requests)\b"
)
WORDS = ["20ms", "0s", "Robot", "Cold", "/scan", "/a__b", "", "none", "a/msg/B", "Zenoh", "DDSRouter", "x" * 64, "500m"]
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8)
    | st.sampled_from(WORDS),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=4,
)  # fmt: skip


def places(value: Any, path: str = "") -> list[str]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = []
    for key, child in children:
        here = f"{path}.{key}" if path else str(key)
        found += [here, *places(child, here)]
    return found


PLACES = [path for path in places(sample()) if path.startswith("spec.") and not ONLY_THE_OPERATOR.search(path)]
# What only a rule of a field or between fields refuses, the validator here does not know: it has no CEL.
STRUCTURAL = {"WrongType", "NotSupported", "UnknownField", "Required", "TooMany", "TooLong", "OutOfRange", "Invalid"}


def with_build() -> dict[str, Any]:
    """The sample with a node that is built from everything that a build block can say."""
    values = example_values("spec.cloud.registry", REGISTRY)
    node = values["spec"]["nodes"][2]
    del node["image"]
    node["build"] = {**BUILD, **EVERYTHING, "git": {**BUILD["git"], "paths": ["src/a", "b c"]}}
    return copy.deepcopy(values)


REGISTRY = {
    "repository": "registry.example:5000/robots",
    "pushSecret": {"name": "push"},
    "pullSecret": {"name": "pull"},
    "insecure": True,
}
EVERYTHING: dict[str, Any] = {
    "distro": "jazzy",
    "base": "registry.example/ros:1",
    "runtimeBase": f"registry.example/ros@sha256:{'a' * 64}",
    "packages": ["plugins"],
    "cmakeArguments": ["-DA=1"],
    "skipKeys": ["a"],
    "aptPackages": ["gdb=1.2"],
    "pipPackages": ["numpy[a]==2.1.0"],
    "gitSecret": {"name": "git"},
    "resources": {"limits": {"memory": "1Gi"}},
}
BUILD_PLACES = [
    path
    for path in places(with_build())
    if path.startswith(("spec.nodes.2.build", "spec.cloud.registry")) and not ONLY_THE_OPERATOR.search(path)
]
BUILD_WORDS = [
    "a..b",
    "a/",
    "a.lock",
    "-x",
    "https://a.example/b",
    "git@a.example:b",
    "a b",
    "a\n",
    "$(x)",
    "a:1",
    "../a",
]


def put(values: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """`values` with one field changed."""
    *parents, last = path.split(".")
    target: Any = values
    for part in parents:
        target = target[int(part)] if part.isdigit() else target[part]
    target[int(last) if last.isdigit() else last] = value
    return values


def test_a_build_block_that_says_everything_is_taken() -> None:
    assert not refused(with_build())
    assert not list(problems(with_build()["spec"], SPEC))


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(BUILD_PLACES), ANYTHING | st.sampled_from(BUILD_WORDS))
def test_build_blocks_are_refused_by_the_crd_and_by_the_models_alike(path: str, value: Any) -> None:
    values = put(with_build(), path, copy.deepcopy(value))
    by_models = {reason for _, reason in refused(values)} & STRUCTURAL
    if list(problems(defaulted(values, SCHEMA)["spec"], SPEC)):
        assert by_models
    # The ending .lock is a CEL rule of the field, judged on the real server.
    elif by_models and value != "a.lock":
        assert list(problems(values["spec"], SPEC)), by_models


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(PLACES), ANYTHING)
def test_a_field_that_the_crd_refuses_is_refused_by_the_models(path: str, value: Any) -> None:
    values = changed(path, copy.deepcopy(value))
    if list(problems(defaulted(values, SCHEMA), {**SCHEMA, "properties": {**SCHEMA["properties"], "metadata": {
        "type": "object", "x-kubernetes-preserve-unknown-fields": True}}})):  # fmt: skip
        assert {reason for _, reason in refused(values)} & (
            STRUCTURAL | {"DuplicateNode", "DuplicateTopic", "DuplicateOutput"}
        )


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(PLACES), ANYTHING)
def test_a_field_that_the_models_refuse_is_refused_by_the_crd(path: str, value: Any) -> None:
    values = changed(path, copy.deepcopy(value))
    try:
        parse_object(values, "f.yaml", rules=())
    except SpecError as error:
        found = [finding for finding in error.findings if finding.reason in STRUCTURAL]
        # A sentence of a field's own CEL rule (a range, a reserved name) is checked on the real server.
        cel = ("out of range", "belongs to the agents", "two underscores", "carries the prefix", "agent's own nodes")
        if all(any(words in finding.message for words in cel) for finding in found):
            return
        assert list(problems(values["spec"], SPEC))
