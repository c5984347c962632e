"""Convert dataclasses to plain JSON values and back, by their type hints; values of other types are refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

Reader = Callable[[Any], Any]


class CodecError(ValueError):
    """A value does not fit its type hint."""


def plain(value: Any) -> Any:
    """Return a value as plain JSON: dataclasses as lists of their fields, enums as values, tuples as lists."""
    return _writer(value.__class__)(value)


def typed(kind: Any, value: Any) -> Any:
    """Return the inverse of `plain` for the type `kind`; raise CodecError if the value does not fit."""
    return _reader(kind)(value)


@cache
def _names(cls: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(cls))


@cache
def _writer(kind: Any) -> Reader:
    """Return the writer for one class; built once, like the readers."""
    if is_dataclass(kind):
        names = tuple(field.name for field in fields(kind))
        return lambda value: [_writer((v := getattr(value, name)).__class__)(v) for name in names]
    if issubclass(kind, Enum):
        return lambda value: value.value
    if issubclass(kind, tuple):
        return lambda value: [_writer(v.__class__)(v) for v in value]
    return _same


def _same(value: Any) -> Any:
    return value


@cache
def _reader(kind: Any) -> Reader:
    """Return the reader for one type; built once, because messages are read some hundred times a second."""
    origin = get_origin(kind)
    if origin in (Union, UnionType):
        return _union(kind)
    if origin is tuple:
        return _tuple(get_args(kind))
    if is_dataclass(kind):
        return _record(kind)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _enum(kind)
    return _plain_reader(kind)


def _union(kind: Any) -> Reader:
    members = [m for m in get_args(kind) if m is not type(None)]
    optional = len(members) < len(get_args(kind))
    # Unions of ours differ in their number of fields.
    by_length = {len(fields(m)): _reader(m) for m in members} if len(members) > 1 else {}
    only = _reader(members[0])

    def read(value: Any) -> Any:
        if value is None and optional:
            return None
        if not by_length:
            return only(value)
        if not isinstance(value, list) or len(value) not in by_length:
            raise CodecError(f"{value!r:.80} is none of {kind}")
        return by_length[len(value)](value)

    return read


def _tuple(members: tuple[Any, ...]) -> Reader:
    if len(members) == 2 and members[1] is Ellipsis:
        each = _reader(members[0])
        return lambda value: tuple(map(each, _list(value)))
    readers = tuple(map(_reader, members))
    return lambda value: tuple([r(v) for r, v in zip(readers, _list(value, len(readers)), strict=True)])


def _record(kind: Any) -> Reader:
    hints = get_type_hints(kind)
    readers = tuple(_reader(hints[name]) for name in _names(kind))
    return lambda value: kind(*[r(v) for r, v in zip(readers, _list(value, len(readers)), strict=True)])


def _list(value: Any, length: int = -1) -> list[Any]:
    if not isinstance(value, list) or (length >= 0 and len(value) != length):
        raise CodecError(f"{value!r:.80} has not the form of a record")
    return value


def _enum(kind: type[Enum]) -> Reader:
    by_value = {member.value: member for member in kind}

    def read(value: Any) -> Enum:
        try:
            return by_value[value]
        except (KeyError, TypeError) as error:
            raise CodecError(f"{value!r:.80} is no {kind.__name__}") from error

    return read


def _plain_reader(kind: Any) -> Reader:
    if kind is float:
        return _number

    def read(value: Any) -> Any:
        if type(value) is not kind:  # a truth value is no number
            raise CodecError(f"{value!r:.80} is no {getattr(kind, '__name__', kind)}")
        return value

    return read


def _number(value: Any) -> float:
    if type(value) not in (float, int) or math.isnan(value):
        raise CodecError(f"{value!r:.80} is no number")
    return float(value)
