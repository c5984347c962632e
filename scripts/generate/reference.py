"""The reference page of the resource, from the same schema that the API server has."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.api.v1alpha1.rules import not_yet

Schema = Mapping[str, Any]

_HEAD: Final = """\
<!-- Generated from the models in operator/robot_offload/api by `make generate`; changes here are lost. -->
# RobotOffload

One object describes one robot: its application, which nodes run where, how both sides are connected, and when the
acting side changes. `apiVersion: {version}`, `kind: {kind}`, short name `{short}`, one per robot in a namespace.
The same texts come from `kubectl explain {short}.spec`. Examples: [manifests/samples](../../manifests/samples).

Durations are whole numbers with a unit: `20ms`, `90s`, `10m`, `1m30s`, `2160h`. Quantities are written as Kubernetes
writes them: `500m`, `2`, `512Mi`. A field marked **required** has no default.
"""
_MORE: Final = """
## Rules between fields

The API server refuses an object that breaks one of these. `robot-offload validate FILE --cluster` says the same and
more, before anything is sent: topics that two nodes publish, topics that cross twice, names that would collide.

{rules}

## Not built yet

{unbuilt}

## What `kubectl get` shows

{columns}
"""


def reference(definition: Schema) -> str:
    """Return the page as Markdown.

    Args:
        definition: the CustomResourceDefinition.
    """
    names, version = definition["spec"]["names"], definition["spec"]["versions"][0]
    whole = version["schema"]["openAPIV3Schema"]
    api_version = f"{definition['spec']['group']}/{version['name']}"
    head = _HEAD.format(version=api_version, kind=names["kind"], short=names["shortNames"][0])
    sections = [_section(path, part) for name in ("spec", "status") for path, part in _objects(name, _of(whole, name))]
    rules = [f"- `{path}`: {_text(rule['message'])}." for path, rule in _rules("spec", _of(whole, "spec"))]
    columns = [
        f"- {column['name']}{' (with `-o wide`)' if column.get('priority') else ''}: {column['description']}"
        for column in version["additionalPrinterColumns"]
    ]
    more = _MORE.format(rules="\n".join(rules), unbuilt=_unbuilt(), columns="\n".join(columns))
    return "\n".join([head, *sections]) + more


def _unbuilt() -> str:
    """Return the words that are described above and refused all the same."""
    if not not_yet.NOT_YET:
        return "Every word of this page does what its description says."
    words = [f"- `{word.path}.{word.field}`: {_text(word.meanwhile)}." for word in not_yet.NOT_YET.values()]
    return "\n".join(["This version knows these words and refuses them; what to do meanwhile:", "", *words])


def _of(part: Schema, field: str) -> Schema:
    found: Schema = part["properties"][field]
    return found


def _objects(path: str, part: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield every object with fields of its own, outer ones first, as (path, schema)."""
    if part.get("properties"):
        yield path, part
    for name, field in part.get("properties", {}).items():
        yield from _objects(f"{path}.{name}", field)
    if "items" in part:
        yield from _objects(f"{path}[]", part["items"])


def _rules(path: str, part: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield the rules between fields; a range of one field stands in its own description already."""
    if part.get("properties"):
        for rule in part.get("x-kubernetes-validations", ()):
            yield path, rule
    for name, field in part.get("properties", {}).items():
        yield from _rules(f"{path}.{name}", field)
    if "items" in part:
        yield from _rules(f"{path}[]", part["items"])


def _section(path: str, part: Schema) -> str:
    required = part.get("required", ())
    rows = [
        f"| `{name}` | {_kind(field)} | {'**Required.** ' if name in required else ''}{_text(field['description'])} |"
        for name, field in part["properties"].items()
    ]
    return "\n".join(
        [f"## {path}", "", _text(part["description"]), "", "| Field | Type | Meaning |", "|---|---|---|", *rows, ""]
    )


def _kind(field: Schema) -> str:
    """Return what a value looks like, in a word or two."""
    if "x-kubernetes-int-or-string" in field:
        return "quantity"
    kind = field.get("type", "object")
    if kind == "array":
        return f"list of {_kind(field['items'])}s"
    if isinstance(field.get("additionalProperties"), dict):
        return f"mapping to {_kind(field['additionalProperties'])}s"
    if field.get("pattern", "").endswith("ms)?$"):
        return "duration"
    words = {"string": "text", "boolean": "true or false", "integer": "whole number", "number": "number"}
    return words.get(kind, "block")


def _text(text: str) -> str:
    """Return one line that Markdown does not take apart."""
    return re.sub(r"([|<*_])", r"\\\1", " ".join(text.split()))
