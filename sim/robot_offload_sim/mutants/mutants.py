"""Proof of teeth: faults planted on purpose, each of which the simulation must find.

A mutant edits the source of the core. While it is `planted` the functions whose code the edit changes run the edited
code in place, wherever they are imported, and constants have the edited value. The core itself knows nothing of this.
The list stands in `mutant_list.py`.
"""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from types import FunctionType, ModuleType
from typing import Any

CORE = "robot_offload_core"
PLAIN = (int, float, str, tuple, frozenset)


class MutantError(Exception):
    """An edit that fits the core no longer: the text to replace must stand there exactly once."""


@dataclass(frozen=True)
class Edit:
    """Replaces `old`, which stands once in the module of the core, with `new`."""

    module: str
    old: str
    new: str


@dataclass(frozen=True)
class Mutant:
    """A planted fault.

    Attributes:
        meaning: what the edited core does wrong.
        story: the name of the story that finds it.
        edits: one, or several where other rules guard the same.
    """

    meaning: str
    story: str
    edits: tuple[Edit, ...]


@dataclass(frozen=True)
class Equivalent:
    """An edit that nobody can notice by itself, and why."""

    meaning: str
    why: str
    edits: tuple[Edit, ...]


@contextmanager
def planted(mutant: Mutant | Equivalent | None) -> Iterator[None]:
    """Plant a mutant (None: none) for the time of the block; raise MutantError when it does not fit."""
    undo: list[tuple[Any, str, Any]] = []
    try:
        for module_name in dict.fromkeys(edit.module for edit in mutant.edits) if mutant else ():
            assert mutant is not None
            module = importlib.import_module(f"{CORE}.{module_name}")
            _plant(module, _edited(module, [e for e in mutant.edits if e.module == module_name]), undo)
        yield
    finally:
        for owner, attribute, value in reversed(undo):
            setattr(owner, attribute, value)


def _edited(module: ModuleType, edits: list[Edit]) -> dict[str, Any]:
    """Return what the edited source defines."""
    source = inspect.getsource(module)
    for edit in edits:
        if source.count(edit.old) != 1:
            raise MutantError(f"{edit.module}: {source.count(edit.old)} times instead of once: {edit.old!r}")
        source = source.replace(edit.old, edit.new)
    defined = {"__name__": module.__name__, "__file__": module.__file__}
    exec(compile(source, f"{module.__file__} (edited)", "exec"), defined)  # noqa: S102 - our own source, edited
    return defined


def _plant(module: ModuleType, defined: dict[str, Any], undo: list[tuple[Any, str, Any]]) -> None:
    for name, new in defined.items():
        old = getattr(module, name, None)
        if isinstance(new, FunctionType) and new.__module__ == module.__name__:
            _swap(old, new, undo)
        elif isinstance(new, type) and new.__module__ == module.__name__:
            for attribute, member in vars(new).items():
                mine = vars(old).get(attribute)
                if isinstance(member, property):
                    _swap(mine.fget if isinstance(mine, property) else None, member.fget, undo)
                elif not attribute.startswith("__") or attribute == "__init__":
                    _swap(mine, member, undo)
        elif isinstance(new, PLAIN) and not name.startswith("__") and (known := _known(new, module)) != old:
            _set_everywhere(name, old, known, undo)


def _known(value: Any, module: ModuleType) -> Any:
    """Return a constant of the edited source with the module's own enumerations, records and functions in it.

    Else a table would hold twins of them, which the module's code takes for none of its own.
    """
    if isinstance(value, tuple):
        return tuple(_known(item, module) for item in value)
    kind = type(value)
    if kind.__module__ != module.__name__:
        mine = isinstance(value, FunctionType) and value.__module__ == module.__name__
        return getattr(module, value.__name__, value) if mine else value
    if isinstance(value, Enum):
        return getattr(module, kind.__name__)[value.name]
    if is_dataclass(value):
        return getattr(module, kind.__name__)(**{f.name: _known(getattr(value, f.name), module) for f in fields(value)})
    return value


def _swap(old: Any, new: Any, undo: list[tuple[Any, str, Any]]) -> None:
    """Let the function `old` run the code of `new`."""
    if isinstance(old, FunctionType) and isinstance(new, FunctionType) and old.__code__ != new.__code__:
        undo.append((old, "__code__", old.__code__))
        old.__code__ = new.__code__


def _set_everywhere(name: str, old: Any, new: Any, undo: list[tuple[Any, str, Any]]) -> None:
    """Set a constant in every module that has imported it."""
    for module in [m for key, m in sys.modules.items() if key.startswith(CORE)]:
        if name in vars(module) and vars(module)[name] == old:
            undo.append((module, name, old))
            setattr(module, name, new)
