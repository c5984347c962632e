"""The models as a CustomResourceDefinition: pure, and the only way in which it comes about.

pydantic describes a model in JSON Schema; the API server wants a structural schema: every type in place, nothing
referred to, no `null` as a type of its own, no patterns of property names. `_structural` translates. The rules between
fields come from `v1alpha1.rules`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from robot_offload.api.v1alpha1.model import NO_SERVER_DEFAULT, Model
from robot_offload.api.v1alpha1.names import MAX_NAME_LENGTH, RESOURCE_PATTERN
from robot_offload.api.v1alpha1.robotoffload import API_VERSION, KIND, RobotOffload, RobotOffloadSpec
from robot_offload.api.v1alpha1.rules import RULES
from robot_offload.api.v1alpha1.status import RobotOffloadStatus

Schema = dict[str, Any]

GROUP: Final = API_VERSION.partition("/")[0]
VERSION: Final = API_VERSION.partition("/")[2]
PLURAL: Final = "robotoffloads"
SINGULAR: Final = "robotoffload"
SHORT_NAME: Final = "roff"

_MARK: Final = next(iter(NO_SERVER_DEFAULT))
_DROPPED: Final = ("title", "propertyNames")
_READY: Final = '.status.conditions[?(@.type=="Ready")].status'
# Name, type, path, description, priority (0 is always shown, 1 with -o wide).
_COLUMNS: Final = (
    ("Placement", "string", ".status.placement", "The side that acts.", 0),
    ("Reason", "string", ".status.placementReason", "Why that side acts.", 0),
    ("Robot", "boolean", ".status.robot.connected", "Whether the robot is connected.", 0),
    ("Ready", "string", _READY, "Whether everything in the cloud is as declared.", 0),
    ("Nodes", "string", ".status.nodesReady", "How many replicas in the cloud are ready.", 0),
    ("Age", "date", ".metadata.creationTimestamp", "Time since the object was made.", 0),
    ("Since", "date", ".status.robot.since", "Time since the robot came or went.", 1),
    ("Transport", "string", ".spec.transport.type", "How robot and cloud are connected.", 1),
)


def crd() -> Schema:
    """Return the CustomResourceDefinition of RobotOffload."""
    return {
        "apiVersion": "apiextensions.k8s.io/v1",
        "kind": "CustomResourceDefinition",
        "metadata": {"name": f"{PLURAL}.{GROUP}", "labels": {"app.kubernetes.io/name": "robot-offload"}},
        "spec": {
            "group": GROUP,
            "names": {
                "kind": KIND,
                "listKind": f"{KIND}List",
                "plural": PLURAL,
                "singular": SINGULAR,
                "shortNames": [SHORT_NAME],
            },
            "scope": "Namespaced",
            "versions": [
                {
                    "name": VERSION,
                    "served": True,
                    "storage": True,
                    "schema": {"openAPIV3Schema": schema()},
                    "subresources": {
                        "status": {},
                        "scale": {
                            "specReplicasPath": ".spec.replicas",
                            "statusReplicasPath": ".status.replicas",
                            "labelSelectorPath": ".status.selector",
                        },
                    },
                    "additionalPrinterColumns": [_column(*column) for column in _COLUMNS],
                }
            ],
        },
    }


def schema() -> Schema:
    """Return the structural schema of the whole resource, with the rules between fields."""
    spec, status = _described(RobotOffloadSpec), _without_defaults(_described(RobotOffloadStatus))
    whole: Schema = {
        "type": "object",
        "description": str(RobotOffload.__doc__),
        "required": ["spec"],
        "properties": {
            "apiVersion": {"type": "string", "description": f"The version of this format: {API_VERSION}."},
            "kind": {"type": "string", "description": f"The kind of object: {KIND}."},
            "metadata": {
                "type": "object",
                "properties": {
                    "name": {"type": "string", "maxLength": MAX_NAME_LENGTH, "pattern": RESOURCE_PATTERN},
                },
            },
            "spec": spec,
            "status": status,
        },
    }
    for rule in RULES:
        part_at(whole, rule.path).setdefault("x-kubernetes-validations", []).append(rule.schema())
    return whole


def part_at(whole: Schema, path: str) -> Schema:
    """Return the schema of the field at `path`; `nodes[]` is a list's entry, `env{}` a mapping's value."""
    part = whole
    for name in path.split("."):
        part = part["properties"][name.removesuffix("[]").removesuffix("{}")]
        if name.endswith("[]"):
            part = part["items"]
        elif name.endswith("{}"):
            part = part["additionalProperties"]
    return part


def _column(name: str, kind: str, path: str, description: str, priority: int) -> Schema:
    column: Schema = {"name": name, "type": kind, "jsonPath": path, "description": description}
    return column | ({"priority": priority} if priority else {})


def _described(model: type[Model]) -> Schema:
    described = model.model_json_schema(mode="serialization")
    return _structural(described, described.get("$defs", {}))


def _structural(described: Mapping[str, Any], definitions: Mapping[str, Any]) -> Schema:
    """Return a JSON Schema of pydantic's as a structural schema."""
    part = dict(described)
    part.pop("$defs", None)
    if "anyOf" in part and {"type": "null"} in part["anyOf"]:
        [inner] = [choice for choice in part.pop("anyOf") if choice != {"type": "null"}]
        # The API server drops a null where nothing else is said, which is what a default of None means.
        kept = {"nullable": True} if part.get("default") is not None else NO_SERVER_DEFAULT
        return _structural({**part, **inner, **kept}, definitions)
    if "$ref" in part:
        target = definitions[part.pop("$ref").removeprefix("#/$defs/")]
        own = part.get("description", "")
        part = {**target, **part, "description": _joined(own, target.get("description", ""))}
    _mapping(part)
    if "properties" in part:
        part["properties"] = {name: _structural(it, definitions) for name, it in part["properties"].items()}
    for nested in ("items", "additionalProperties"):
        if isinstance(part.get(nested), dict):
            part[nested] = _structural(part[nested], definitions)
    _default(part)
    for name in _DROPPED:
        part.pop(name, None)
    return _ordered(part)


def _joined(field: str, model: str) -> str:
    """Return what a field is for, then what its parts have in common."""
    if not model or model in field:
        return field
    return model if model.startswith(field.removesuffix(".")) else f"{field} {model}"


def _mapping(part: Schema) -> None:
    """Convert mappings to one schema for all values. The form of the keys is judged by the operator alone."""
    if part.get("additionalProperties") is False:
        del part["additionalProperties"]
    patterns = part.pop("patternProperties", None)
    if patterns is not None:
        [part["additionalProperties"]] = patterns.values()


def _default(part: Schema) -> None:
    """Leave the defaults that say more than "nothing": the API server writes what it fills in into every object."""
    if part.get("default") in (None, [], {}, "") or isinstance(part["default"], dict):
        part.pop("default", None)
    for field in part.get("properties", {}).values():
        # Written out in full: the API server holds a default against the rules before it fills in what is inside.
        inside = {name: it["default"] for name, it in field.get("properties", {}).items() if "default" in it}
        if inside and "required" not in field and _MARK not in field:
            field["default"] = inside
        field.pop(_MARK, None)


def _without_defaults(part: Schema) -> Schema:
    """Return the status as the operator alone writes it: the API server fills in nothing."""
    part.pop("default", None)
    for field in part.get("properties", {}).values():
        _without_defaults(field)
    if "items" in part:
        _without_defaults(part["items"])
    return part


def _ordered(part: Schema) -> Schema:
    """Return the keys in the order in which a person reads them."""
    first = ("description", "type", "format", "nullable", "default", "enum", "pattern")
    return {key: part[key] for key in first if key in part} | {key: it for key, it in part.items() if key not in first}
