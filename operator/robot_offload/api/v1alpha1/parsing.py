"""From text or plain objects to a `RobotOffload`, with every problem at once as one line for a person."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, TypeAlias, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from robot_offload.api.strict_yaml import YamlError, freeze, parse
from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.robotoffload import KIND, RobotOffload
from robot_offload.api.v1alpha1.rules import CHECKS, Check, check
from robot_offload.errors import SpecError
from robot_offload.findings import Finding

Location = tuple[int | str, ...]
_SERVER_WRITTEN: Final = (
    "uid", "resourceVersion", "generation", "creationTimestamp", "managedFields", "selfLink", "deletionTimestamp",
    "deletionGracePeriodSeconds", "finalizers", "ownerReferences",
)  # fmt: skip
"""Fields of metadata that a cluster writes, not the author of a file."""
Unknown: TypeAlias = Literal["forbid", "ignore"]
"""What happens to fields that no model has: people are told, the operator goes on without them, so that it can be
rolled back while newer objects exist."""

_EXPECTED: Final = {
    "bool_type": "true or false",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "string_type": "text",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "finite_number": "a finite number",
}
_LIMITS: Final = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
MAX_BYTES: Final = 262_144
"""Of a specification as JSON. The API server works through all of it whenever a status is written: 0.6 s for 0.9 MB."""
_SIZES: Final = ("too_short", "too_long", "string_too_long")


def parse_text(text: str, source: str, *, unknown: Unknown = "forbid", rules: Sequence[Check] = CHECKS) -> RobotOffload:
    """Read one RobotOffload from YAML (or JSON) text.

    Args:
        text: the whole document.
        source: what to call it in messages, normally the file's name.
        unknown: what happens to fields that no model has.
        rules: the rules between fields, CHECKS or CLUSTER_CHECKS.

    Raises:
        SpecError: with every problem found. Rules between fields are only checked once all fields are right.
    """
    try:
        value = parse(text)
    except YamlError as error:
        raise SpecError(source, [Finding(error.position, "NotYaml", error.problem)]) from error
    return parse_object(value, source, unknown=unknown, rules=rules)


def parse_object(
    value: object, source: str, *, unknown: Unknown = "forbid", rules: Sequence[Check] = CHECKS
) -> RobotOffload:
    """Read one RobotOffload from plain values (mappings, list, texts, numbers).

    An object as the API server returns it (with `status` and all of `metadata`) is read with `unknown="ignore"`.

    Args:
        value: the whole object.
        source: what to call it in messages.
        unknown: what happens to fields that no model has.
        rules: the rules between fields, CHECKS or CLUSTER_CHECKS.

    Raises:
        SpecError: as `parse_text` does.
    """
    listed = items(value)
    if listed is not None:
        if len(listed) != 1:
            message = f"a list of {len(listed)} objects; one is read here: name it in kubectl get, or write it alone"
            raise SpecError(source, [Finding("", "WrongType", message)])
        return parse_object(listed[0], source, unknown=unknown, rules=rules)
    if not isinstance(value, Mapping):
        message = f"must be a mapping with apiVersion, kind, metadata and spec, found {_kind_of(value)}"
        raise SpecError(source, [Finding("", "WrongType", message)])
    size = _size(value.get("spec"))
    if size > MAX_BYTES:
        message = f"has {size} bytes, more than {MAX_BYTES}; move parameters into ConfigMaps (run.parametersFrom)"
        raise SpecError(source, [Finding("spec", "TooLarge", message)])
    try:
        offload = RobotOffload.model_validate(freeze(_as_applied(value)), by_alias=True, by_name=False, extra=unknown)
    except RecursionError:
        raise SpecError(source, [Finding("", "Invalid", "lists or mappings are nested too deeply")]) from None
    except ValidationError as error:
        raise SpecError(source, findings_of(error)) from error
    errors = [finding for finding in check(offload.spec, rules) if finding.severity == "error"]
    if errors:
        raise SpecError(source, errors)
    return offload


def _size(value: object) -> int:
    """Return the bytes of a value as JSON; 0: it cannot be written so, which other checks say better."""
    try:
        return len(json.dumps(value, separators=(",", ":")).encode())
    except (TypeError, ValueError, RecursionError):
        return 0


def items(value: object) -> tuple[object, ...] | None:
    """Return the objects of a list, as `kubectl get -o yaml` writes several; None: the value is not a list."""
    if not isinstance(value, Mapping) or value.get("kind") not in ("List", f"{KIND}List"):
        return None
    found = value.get("items")
    return tuple(found) if isinstance(found, tuple | list) else ()


def _as_applied(value: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """Return what the author of an object wrote: one that a cluster keeps (it has a uid) carries more."""
    metadata = value.get("metadata")
    if not isinstance(metadata, Mapping) or not metadata.get("uid"):
        return value
    kept = {name: it for name, it in metadata.items() if name not in _SERVER_WRITTEN}
    return {**{name: it for name, it in value.items() if name != "status"}, "metadata": kept}


_ONE_NODE: Final = (
    "; in the cloud one pod runs one node (docs/decisions/0016-one-node-one-pod.md): write an entry under nodes for "
    "each, with run.package and run.executable. "
)
_ELSEWHERE: Final[Mapping[Location, str]] = {
    ("run", "launch"): f"{_ONE_NODE}On the robot the bundle's robot.launch.py includes your launch file as it is",
    ("run", "components"): f"{_ONE_NODE}On the robot they stay composed: each remapping names its node",
    ("run", "container"): f"{_ONE_NODE}On the robot they stay composed: each remapping names its node",
}
"""Fields that people look for, by their place and name, and where what they are for is done."""


def findings_of(error: ValidationError, root: type[Model] = RobotOffload) -> list[Finding]:
    """Return everything that pydantic complains of, in our words; never empty.

    Args:
        error: from validating values of `root`.
        root: the model whose fields are suggested where one is unknown or missing.
    """
    return [_finding(detail, root) for detail in error.errors(include_url=False) if not _misleading(detail)]


def _misleading(detail: ErrorDetails) -> bool:
    """Return whether pydantic only repeats another problem.

    It calls a list too short because all its entries are wrong, and works out no default from a field that is wrong.
    """
    return detail["type"] == "default_factory_not_called" or (detail["type"] == "too_short" and bool(detail["input"]))


def _finding(detail: ErrorDetails, root: type[Model]) -> Finding:
    """Return one of pydantic's errors in our words."""
    kind, location, given = detail["type"], detail["loc"], detail["input"]
    context = detail.get("ctx", {})
    path = path_of(location)
    if kind == "extra_forbidden" and location[0] == "metadata" and location[-1] in _SERVER_WRITTEN:
        return Finding(path, "ServerWritten", "is for the cluster's own programs to write; remove it from the file")
    if kind == "extra_forbidden":
        meanwhile = _ELSEWHERE.get(location[-2:], "")
        return Finding(path, "UnknownField", f"is not a known field{meanwhile or _instead(location, root)}")
    if kind == "missing":
        return Finding(path, "Required", f"is missing{_meaning(location, root)}")
    if kind == "literal_error":
        return Finding(path, "NotSupported", _not_one_of(given, str(context.get("expected", ""))))
    if kind == "value_error":
        return Finding(path, "Invalid", _one_line(str(context.get("error", detail["msg"]))))
    if kind in _EXPECTED:
        return Finding(path, "WrongType", f"must be {_EXPECTED[kind]}, found {_kind_of(given)}")
    if kind in _LIMITS or kind in _SIZES:
        return _limit(kind, path, context, given)
    return Finding(path, "Invalid", _one_line(detail["msg"]))


def _limit(kind: str, path: str, context: Mapping[str, Any], given: object) -> Finding:
    """Return a number, a list or a text that is too small or too large."""
    if kind == "too_short":
        return Finding(path, "Required", "must have at least one entry")
    if kind == "too_long":
        return Finding(path, "TooMany", f"has {context['actual_length']} entries; at most {context['max_length']} fit")
    if kind == "string_too_long":
        return Finding(path, "TooLong", f"is longer than {context['max_length']} characters")
    limit, words = _LIMITS[kind]
    return Finding(path, "OutOfRange", f"must be {words} {context[limit]:g}, found {_kind_of(given)}")


def path_of(location: Location) -> str:
    """Return a location as it is written in messages: `spec.nodes[1].name`."""
    path = ""
    for part in location:
        if part == "[key]":  # what pydantic says about a key stands with the key
            continue
        if isinstance(part, int):
            path += f"[{part}]"
        elif re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", part):
            path += f".{part}" if path else part
        else:
            path += f"[{_cut(json.dumps(part))}]"
    return path


def _instead(location: Location, root: type[Model]) -> str:
    """Return what could have been meant by an unknown field."""
    model = _model_at(location[:-1], root)
    known = sorted(_fields(model)) if model else []
    return _suggestion(str(location[-1]), known) or (f"; known here: {', '.join(known)}" if known else "")


def _not_one_of(given: object, expected: str) -> str:
    known = re.findall(r"'([^']*)'", expected)
    if not isinstance(given, str):
        return f"must be one of {', '.join(known)}, found {_kind_of(given)}"
    listed = ", ".join(known) if len(known) > 1 else (known or [""])[0]
    words = "is not one of" if len(known) > 1 else "must be"
    return f"{_cut(repr(given))} {words} {listed}{_suggestion(given, known) if len(known) > 1 else ''}"


def _suggestion(given: str, known: Iterable[str]) -> str:
    """Return `; did you mean X?`, comparing without regard to case and underscores."""
    plain = {name.lower(): name for name in known}
    close = difflib.get_close_matches(given[:80].lower().replace("_", ""), plain, n=1, cutoff=0.7)
    return f"; did you mean {plain[close[0]]}?" if close else ""


def _meaning(location: Location, root: type[Model]) -> str:
    """Return what a missing field is for: its description, in brackets."""
    model = _model_at(location[:-1], root)
    field = _fields(model).get(str(location[-1])) if model else None
    return f" ({field.description.rstrip('.')})" if field and field.description else ""


def _fields(model: type[Model]) -> dict[str, Any]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _model_at(location: Location, root: type[Model]) -> type[Model] | None:
    """Return the model that stands at `location` of a document of `root`, or None where there is none."""
    current: Any = root
    for part in location:
        current = _bare(current)
        if isinstance(current, type) and issubclass(current, Model):
            field = _fields(current).get(str(part))
            current = field.annotation if field else None
        elif get_origin(current) is tuple and isinstance(part, int):
            current = get_args(current)[0]
        else:
            return None
    current = _bare(current)
    return current if isinstance(current, type) and issubclass(current, Model) else None


def _bare(annotation: Any) -> Any:
    """Return `annotation` without Annotated[...] and without `| None`."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif get_origin(annotation) in (Union, UnionType):
            annotation = next(choice for choice in get_args(annotation) if choice is not NoneType)
        else:
            return annotation


def _kind_of(value: object) -> str:
    """Return what a value is, in words, with the value itself where it is short."""
    if value is None:
        return "nothing (remove the line or give a value)"
    if isinstance(value, bool):
        return f"{'true' if value else 'false'} (write text in quotes)"
    if isinstance(value, int | float):
        return f"the number {value}"
    if isinstance(value, str):
        return f"the text {_cut(repr(value))}"
    return "a mapping" if isinstance(value, Mapping) else "a list"


def _cut(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:56]}..."


def _one_line(text: str) -> str:
    return " ".join(text.split())
