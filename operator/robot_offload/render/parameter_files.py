"""Users' ROS 2 parameter files for replicas: the replica of `controller_server` is called `remote_controller_server`.

ROS 2 gives a node the parameters under its own name, so without a new key a replica would silently run with its
defaults. Only the keys are changed, in the original text: parsing and writing YAML could turn a number into a text or a
double into an integer.

The files come from users, so their cost is bounded: their size, their nesting (libyaml needs quadratic time for nested
brackets), and how often they are read: once for all nodes, and not again while text and names stay.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import yaml

from robot_offload.api.v1alpha1 import RobotOffloadSpec
from robot_offload.errors import InputError
from robot_offload.render.ros_names import replica_name

MAX_FILE: Final = 262_144
"""Maximum bytes of a parameter file. Those of Nav2's own bring-up have some 20 KiB."""
MAX_FILES: Final = 786_432
"""Maximum bytes of all renamed files of one RobotOffload: they share one ConfigMap, which takes 1 MiB."""
MAX_DEPTH: Final = 64
"""Levels of nesting; ROS 2's own reader of parameter files accepts fewer."""
_PARAMETERS: Final = "ros__parameters"
_KEPT: Final = 64
"""Renamed files kept in memory, for all RobotOffloads."""


class TooLargeError(InputError):
    """Parameter files are too large for an operator that serves many robots."""


@dataclass(frozen=True, slots=True)
class RenamedFile:
    """A user's parameter file, with the names of its replicas.

    Attributes:
        entry: its source, `name/key` of a ConfigMap.
        key: its key in the shared ConfigMap.
        text: its content.
    """

    entry: str
    key: str
    text: str


def renamed_files(spec: RobotOffloadSpec, configs: Mapping[str, str]) -> dict[str, RenamedFile]:
    """Return the files in which replicas find their own names, by source.

    Args:
        spec: the nodes and their files.
        configs: the users' files by `name/key`; missing ones are left out.

    Raises:
        TooLargeError: one of them, or all together, are too large.
    """
    names: dict[str, dict[str, str]] = {}
    for node in spec.cloud_nodes:
        if node.duplicated and node.run is not None and node.run.parameters_from is not None:
            reference = node.run.parameters_from.config_map_key_ref
            names.setdefault(f"{reference.name}/{reference.key}", {})[node.name] = replica_name(node, "cloud")
    read = {entry: configs[entry] for entry in names if entry in configs}
    _check_sizes(read)
    return {
        # The name of a ConfigMap has no underscore, so two entries never share a key.
        entry: RenamedFile(entry, entry.replace("/", "_", 1), renamed(text, tuple(sorted(names[entry].items()))))
        for entry, text in read.items()
    }


def _check_sizes(files: Mapping[str, str]) -> None:
    sizes = {entry: len(text.encode(errors="replace")) for entry, text in files.items()}
    for entry, size in sizes.items():
        if size > MAX_FILE:
            raise TooLargeError(
                f"the parameter file {entry} has {size} bytes, more than {MAX_FILE}; split it: a node needs "
                "only its own parameters"
            )
    if sum(sizes.values()) > MAX_FILES:
        raise TooLargeError(
            f"the parameter files {', '.join(sizes)} have {sum(sizes.values())} bytes together, more than {MAX_FILES}; "
            "leave out parameters of nodes that do not run in the cloud"
        )


@lru_cache(maxsize=_KEPT)
def renamed(text: str, names: tuple[tuple[str, str], ...]) -> str:
    """Return a parameter file for replicas.

    Args:
        text: the user's file; invalid YAML is returned unchanged, ROS 2 then reports the error.
        names: of nodes, without their namespaces, and of their replicas.
    """
    replicas = dict(names)
    try:
        keys = _keys(yaml.parse(text, Loader=yaml.CSafeLoader), replicas)
    except yaml.YAMLError:
        return text
    parts, end = [], 0
    for start, stop, value in sorted(map(_place, keys)):
        head, slash, name = value.rpartition("/")
        parts += [text[end:start], head, slash, replicas[name]]
        end = stop
    return "".join((*parts, text[end:]))


def _place(key: yaml.ScalarEvent) -> tuple[int, int, str]:
    """Return where a key begins and ends in the text, and its value."""
    assert key.start_mark is not None
    assert key.end_mark is not None
    return key.start_mark.index, key.end_mark.index, str(key.value)


@dataclass(slots=True)
class _Level:
    """An open mapping or list.

    Attributes:
        mapping: whether it is a mapping.
        anchor: its own name for aliases; None: it has none.
        key: the key whose value is next; None: a key is next, or the key is not a scalar.
        expects_key: whether a key is next.
        holds: whether it directly contains parameters.
        found: inner keys to be renamed.
    """

    mapping: bool
    anchor: str | None = None
    key: yaml.ScalarEvent | None = None
    expects_key: bool = True
    holds: bool = False
    found: list[yaml.ScalarEvent] = field(default_factory=list)


def _keys(events: Iterable[yaml.Event], names: Mapping[str, str]) -> list[yaml.ScalarEvent]:
    """Return the keys of these nodes' parameters.

    Namespaces may be part of a key or separate keys. Works on events, without recursion: users choose the depth.
    """
    levels = [_Level(mapping=False)]
    holders: set[str] = set()
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            if len(levels) > MAX_DEPTH:
                raise yaml.YAMLError(f"more than {MAX_DEPTH} levels")
            levels.append(_Level(isinstance(event, yaml.MappingStartEvent), event.anchor))
        elif isinstance(event, yaml.CollectionEndEvent):
            inner = levels.pop()
            if inner.holds and inner.anchor:
                holders.add(inner.anchor)
            _value(levels[-1], names, inner.holds, inner.found if inner.mapping else [])
        elif isinstance(event, yaml.AliasEvent):
            _value(levels[-1], names, event.anchor in holders, [])
        elif isinstance(event, yaml.ScalarEvent):
            _scalar(levels[-1], event)
    return levels[0].found


def _scalar(level: _Level, event: yaml.ScalarEvent) -> None:
    if level.mapping and level.expects_key:
        level.key, level.expects_key = event, False
        level.holds = level.holds or event.value == _PARAMETERS
    else:
        level.key, level.expects_key = None, True


def _value(level: _Level, names: Mapping[str, str], holds: bool, found: list[yaml.ScalarEvent]) -> None:
    """Record that a collection has ended as a value (or as a key) of `level`."""
    if level.mapping and level.expects_key:
        level.expects_key = False
        return
    if not holds:
        level.found += found
    elif level.key is not None and level.key.value.rpartition("/")[2] in names:
        level.found.append(level.key)
    level.key, level.expects_key = None, True
