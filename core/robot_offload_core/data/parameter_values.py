"""Parameters of nodes as state: the message from the holder to the standby, and which values to set there. Pure.

A message is JSON, `{NODE: {PARAMETER: [TYPE, VALUE]}}`; TYPE is a number of `rcl_interfaces/msg/ParameterType`. It may
come from any node: unless it is whole and correctly typed, none of it is used.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, Final

from robot_offload_core.fence.token import Site
from robot_offload_core.words.parameters import MAX_NAME, MAX_SHOWN, PRIVATE_TOPICS

MAX_NODES: Final = 32
MAX_PARAMETERS: Final = 4096
"""Most parameters of one node; the largest nodes of Nav2 have some 200."""
_INTEGERS = range(-(1 << 63), 1 << 63)


class Type(IntEnum):
    """Types of a parameter as `rcl_interfaces/msg/ParameterType` numbers them; NOT_SET (0) is never carried."""

    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9


_ELEMENTS = {
    Type.BYTE_ARRAY: Type.INTEGER,
    Type.BOOL_ARRAY: Type.BOOL,
    Type.INTEGER_ARRAY: Type.INTEGER,
    Type.DOUBLE_ARRAY: Type.DOUBLE,
    Type.STRING_ARRAY: Type.STRING,
}
Value = tuple[int, Any]
"""Type and value; arrays are lists, bytes are whole numbers."""
Table = Mapping[str, Value]
Tables = Mapping[str, Table]
"""Tables by the node's resource name."""


def encode(tables: Tables) -> bytes:
    """Encode parameters; equal parameters give equal messages."""
    return json.dumps(tables, sort_keys=True, separators=(",", ":")).encode()


def decode(message: bytes) -> dict[str, dict[str, Value]] | None:
    """Decode a message; return None if it is not valid."""
    try:
        found = json.loads(message)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or len(found) > MAX_NODES:
        return None
    tables = {node: _table(table) for node, table in found.items() if len(node) <= MAX_NAME}
    whole = {node: table for node, table in tables.items() if table is not None}
    return whole if len(whole) == len(found) else None


def _table(found: object) -> dict[str, Value] | None:
    if not isinstance(found, dict) or len(found) > MAX_PARAMETERS:
        return None
    table: dict[str, Value] = {}
    for name, value in found.items():
        if not (isinstance(value, list) and len(value) == 2 and 0 < len(name) <= MAX_NAME and _fits(*value)):
            return None
        table[name] = (value[0], value[1])
    return table


def _fits(kind: object, value: object) -> bool:
    """Return whether a value has its stated type."""
    if isinstance(kind, bool) or not isinstance(kind, int) or kind not in set(Type):
        return False
    element = _ELEMENTS.get(Type(kind))
    if element is None:
        return _is_one(Type(kind), value)
    if not isinstance(value, list) or not all(_is_one(element, each) for each in value):
        return False
    return kind != Type.BYTE_ARRAY or all(0 <= each < 256 for each in value)


def _is_one(kind: Type, value: object) -> bool:
    if kind is Type.BOOL:
        return isinstance(value, bool)
    if kind is Type.INTEGER:
        return isinstance(value, int) and not isinstance(value, bool) and value in _INTEGERS
    if kind is Type.DOUBLE:
        return isinstance(value, float)
    return isinstance(value, str)


def here(table: Table, site: Site) -> dict[str, Value]:
    """Return parameters with private topics of the other side replaced by those of this side."""
    return {name: (kind, _renamed(value, site)) for name, (kind, value) in table.items()}


def _renamed(value: Any, site: Site) -> Any:
    if isinstance(value, str):
        return value.replace(PRIVATE_TOPICS.format(site.other.value), PRIVATE_TOPICS.format(site.value))
    return [_renamed(each, site) for each in value] if isinstance(value, list) else value


def unlike(wanted: Table, own: Table) -> dict[str, Value]:
    """Return the values to set so that `own` equals `wanted`, leaving out names that `own` lacks.

    Values are compared as text: NaN equals NaN.
    """
    return {name: value for name, value in wanted.items() if name in own and repr(own[name]) != repr(value)}


def absent(wanted: Table, own: Table) -> list[str]:
    """Return the wanted names that the node here has not declared."""
    return sorted(name for name in wanted if name not in own)


def sentence(refused: Sequence[str]) -> str:
    """Return a message about parameters that were not taken, each as `NODE.NAME (REASON)`; "" for none."""
    more = f" and {len(refused) - MAX_SHOWN} more" if len(refused) > MAX_SHOWN else ""
    return f"the replica did not take {', '.join(refused[:MAX_SHOWN])}{more}" if refused else ""
