"""What the API server does with a structural schema, as far as ours uses it: fill in defaults, then say what is wrong.

Not the CEL rules: those run on a real API server (tests/integration/test_crd_rules.py).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

_TYPES: Mapping[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
}
KNOWN_KEYS = {
    *("type", "description", "format", "nullable", "default", "enum", "pattern", "minLength", "maxLength"),
    *("minimum", "maximum", "minItems", "maxItems", "maxProperties", "required", "properties", "items"),
    *("additionalProperties", "anyOf", "x-kubernetes-int-or-string", "x-kubernetes-preserve-unknown-fields"),
    *("x-kubernetes-list-type", "x-kubernetes-list-map-keys", "x-kubernetes-validations"),
}


def defaulted(value: Any, schema: Mapping[str, Any]) -> Any:
    """`value` without nulls where the schema has no word for them, and with its defaults where nothing is said."""
    if isinstance(value, dict):
        fields = schema.get("properties", {})
        dropped = [
            name for name, it in value.items() if it is None and not fields.get(name, {"nullable": 1}).get("nullable")
        ]
        value = {name: it for name, it in value.items() if name not in dropped}
        filled = {name: field["default"] for name, field in fields.items() if "default" in field and name not in value}
        return {name: defaulted(it, fields.get(name, {})) for name, it in {**value, **filled}.items()}
    if isinstance(value, list):
        return [defaulted(it, schema.get("items", {})) for it in value]
    return value


def problems(value: Any, schema: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """Paths of everything that the schema refuses, unknown fields included (strict validation)."""
    if value is None and schema.get("nullable"):
        return
    if not _has_type(value, schema) or not _within(value, schema):
        yield path
    elif isinstance(value, dict):
        yield from _object_problems(value, schema, path)
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from problems(item, schema["items"], f"{path}[{i}]")
        keys = schema.get("x-kubernetes-list-map-keys", ())
        named = [tuple(item.get(key) for key in keys) for item in value if keys and isinstance(item, dict)]
        yield from (f"{path}[{i}]" for i, name in enumerate(named) if name in named[:i])


def _object_problems(value: dict[str, Any], schema: Mapping[str, Any], path: str) -> Iterator[str]:
    fields, others = schema.get("properties", {}), schema.get("additionalProperties")
    yield from (f"{path}.{name}" for name in schema.get("required", ()) if name not in value)
    for name, item in value.items():
        if name in fields:
            yield from problems(item, fields[name], f"{path}.{name}")
        elif others is not None:
            yield from problems(item, others, f"{path}.{name}")
        elif not schema.get("x-kubernetes-preserve-unknown-fields"):
            yield f"{path}.{name}"


def _has_type(value: Any, schema: Mapping[str, Any]) -> bool:
    if schema.get("x-kubernetes-int-or-string"):
        return isinstance(value, int | str) and not isinstance(value, bool)
    kinds = _TYPES[schema["type"]]
    return isinstance(value, kinds) and (not isinstance(value, bool) or bool in kinds)


def _within(value: Any, schema: Mapping[str, Any]) -> bool:
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, str):
        size = ("minLength", "maxLength")
        # Go's $ is the end of the text; Python's may stand before a line break at the end.
        if "pattern" in schema and not re.search(schema["pattern"].removesuffix("$") + r"\Z", value):
            return False
    elif isinstance(value, list):
        size = ("minItems", "maxItems")
    elif isinstance(value, dict):
        size = ("minProperties", "maxProperties")
    else:
        return bool(schema.get("minimum", value) <= value <= schema.get("maximum", value))
    least, most = schema.get(size[0], 0), schema.get(size[1], len(value))
    return bool(least <= len(value) <= most)
