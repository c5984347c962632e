"""How a node is started, and what it needs: from its process, if that was found."""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import Any, Final

import yaml

from robot_offload.survey.owners import CONTAINERS, program, ros_arguments
from robot_offload.survey.seen import World
from robot_offload.survey.sketch import NodeSketch, plain
from robot_offload.survey.snapshot import NodeSeen, ProcessSeen

_RENAMES: Final = ("__node", "__name", "__ns")
_OF_EVERY_NODE: Final = ("use_sim_time", "start_type_description_service")
_SCRIPT: Final = re.compile(r"[^-/].*\.(py|sh)")
_LEAST_CPU: Final = 0.05
_MEBIBYTE: Final = 1024 * 1024


def add_to(sketch: NodeSketch, world: World, node: NodeSeen) -> None:
    """Add what the node's process shows: its program, remappings, parameters, processor time and memory."""
    process = world.owned.process.get(node.name)
    given: dict[str, Any] = {}
    if process is None:
        sketch.notes.append("its process was not found on the host that was looked at: CPU, memory, program unknown")
    else:
        cpu, memory = world.owned.cpu(node.name), world.owned.memory(node.name)
        shared = f", shared by {world.owned.shares[node.name]} nodes" if world.owned.shares[node.name] > 1 else ""
        sketch.notes.append(f"{cpu:.1%} of a core, {memory / _MEBIBYTE:.0f} MiB{shared}")
        if sketch.placement != "Robot" and cpu >= _LEAST_CPU:
            sketch.fields["resources"] = {"requests": {"cpu": f"{round(cpu * 1000):d}m",
                                                       "memory": f"{memory // _MEBIBYTE + 1}Mi"}}  # fmt: skip
        given = _given_parameters(node, process)
        first = min(
            name for name, it in world.owned.process.items() if it.pid == process.pid and _is_whole(world, name)
        )
        if first == node.name or program(process) in CONTAINERS:
            _add_run(sketch, process, given, world.folder)
        else:
            sketch.notes.append(
                f"in the process of {plain(first)}: say in run how it is started alone, if it shall leave"
            )
    rest = sorted(set(node.parameters) - set(given) - set(_OF_EVERY_NODE))
    rest = [it for it in rest if not it.startswith("qos_overrides.")]
    if rest:
        shown = ", ".join(f"{plain(it)}: {plain(str(node.parameters[it]))}" for it in rest[:12])
        more = f" and {len(rest) - 12} more" if len(rest) > 12 else ""
        sketch.notes.append(f"parameters, defaults as far as the command line shows: {shown}{more}")
    if node.problem:
        sketch.notes.append(plain(node.problem))


def _is_whole(world: World, node: str) -> bool:
    return world.owned.whole[node] == node


def _add_run(sketch: NodeSketch, process: ProcessSeen, given: dict[str, Any], folder: str) -> None:
    if program(process) in CONTAINERS:
        sketch.notes.append(f"a component in {plain(program(process))}: say in run how it is started alone")
        return
    command, arguments = ros_arguments(process)
    if not command:
        return
    run: dict[str, Any] = {}
    path = PurePosixPath(command[0])
    if len(path.parts) > 3 and path.parts[-3] == "lib" and len(command) == 1:
        run = {"package": path.parts[-2], "executable": path.name}
    else:
        run = {"command": [_word(word, at, process.folder, folder) for at, word in enumerate(command)]}
    remaps = dict(it.split(":=", 1) for kind, it in arguments if kind == "remap" and ":=" in it)
    remaps = {old: new for old, new in remaps.items() if old.rpartition(":")[2] not in _RENAMES and ":" not in old}
    if remaps:
        run["remap"] = remaps
    if given:
        run["parameters"] = given
        whole = [name for name, it in given.items() if isinstance(it, float) and it.is_integer()]
        if whole:
            run["doubles"] = whole
    sketch.fields["run"] = run


def _word(word: str, at: int, started_in: str, folder: str) -> str:
    """Return a word of a command: an interpreter by its own name, a script by a path valid for the file."""
    if at > 0 and _SCRIPT.fullmatch(word) and started_in not in ("", folder):
        return str(PurePosixPath(started_in, word))
    return "python3" if at == 0 and re.fullmatch(r"(.*/)?python[0-9.]*", word) else word


def _given_parameters(node: NodeSeen, process: ProcessSeen) -> dict[str, Any]:
    """Return the parameters with which the node was started, with their present values.

    They differ from its defaults, or could; ROS 2 itself does not report defaults.
    """
    _, arguments = ros_arguments(process)
    names = {it.partition(":=")[0].rpartition(":")[2] for kind, it in arguments if kind == "param"}
    for text in process.parameter_files.values():
        names |= _names_in_file(text, node.name)
    return {name: node.parameters[name] for name in sorted(names) if name in node.parameters}


def _names_in_file(text: str, node: str) -> set[str]:
    try:
        blocks = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError):
        return set()
    if not isinstance(blocks, dict):
        return set()
    last = node.rpartition("/")[2]
    found: set[str] = set()
    for name, block in blocks.items():
        if name in ("/**", "**", node, node.lstrip("/"), last, f"/{last}", f"/**/{last}") and isinstance(block, dict):
            found |= set(_flat(block.get("ros__parameters"), ""))
    return found


def _flat(values: Any, prefix: str) -> list[str]:
    if not isinstance(values, dict):
        return [prefix.rstrip(".")] if prefix else []
    return [name for key, it in values.items() for name in _flat(it, f"{prefix}{key}.")]
