"""The definition of a message type as text (`ros2msg`), made from its Python class.

Every installed type has a class; not every one has its .msg file beside it (IDL types have none). Only the files have
constants and comments, and no reader needs them to understand the bytes.
"""

from __future__ import annotations

import re
import sys
from typing import Any

from robot_offload_agent.ros.interfaces import message_type

SEPARATOR = "=" * 80
EMPTY = {"structure_needs_at_least_one_member": "uint8"}
"""The byte of a message without fields, by the name that the generators of ROS give it."""
_BASIC = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
"""Names of IDL types that differ in a .msg file."""
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, (\d+))?>")
_ARRAY = re.compile(r"(.+)\[(\d+)\]")
_BOUNDED = re.compile(r"(w?string)<(\d+)>")


def definition(kind: Any, name: str) -> str:
    """Return the definition of a type with those of all types in it, as in a rosbag2 file.

    Args:
        kind: the class.
        name: of the type, `PACKAGE/msg/TYPE`.

    Raises:
        StartError: a type in it is not installed.
    """
    text, waiting, known = _fields(kind), _parts(kind), {name.replace("/msg/", "/")}
    while waiting:
        part, within = waiting.pop(0)
        if part in known:
            continue
        known.add(part)
        inner = _part(part, within)
        text += f"{SEPARATOR}\nMSG: {part}\n{_fields(inner)}"
        waiting += _parts(inner)
    return text


def _part(name: str, within: Any) -> Any:
    """Return the class of a type `PACKAGE/TYPE` in another one; the parts of an action are in its module."""
    short = name.partition("/")[2]
    beside = getattr(sys.modules[within.__module__], short, None)
    return beside if beside is not None else message_type(name.replace("/", "/msg/", 1))


def _fields(kind: Any) -> str:
    fields = kind.get_fields_and_field_types() or EMPTY
    return "".join(f"{_written(idl)} {field}\n" for field, idl in fields.items())


def _parts(kind: Any) -> list[tuple[str, Any]]:
    """Return the types of the fields that are messages, `PACKAGE/TYPE`, each with the type that contains it."""
    elements = [_element(idl) for idl in kind.get_fields_and_field_types().values()]
    return [(element, kind) for element in elements if "/" in element]


def _element(idl: str) -> str:
    """Return the type of a field without its sequence or array."""
    match = _SEQUENCE.fullmatch(idl) or _ARRAY.fullmatch(idl)
    return match[1] if match else idl


def _written(idl: str) -> str:
    """Return the type of a field as in a .msg file."""
    if match := _SEQUENCE.fullmatch(idl):
        return f"{_written(match[1])}[{'<=' + match[2] if match[2] else ''}]"
    if match := _ARRAY.fullmatch(idl):
        return f"{_written(match[1])}[{match[2]}]"
    if match := _BOUNDED.fullmatch(idl):
        return f"{match[1]}<={match[2]}"
    return _BASIC.get(idl, idl)
