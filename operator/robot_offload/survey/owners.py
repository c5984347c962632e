"""Which process runs which node, and which nodes are only parts of another: from identifiers and command lines.

A node is found in its process in this order:
1. Fast DDS: bytes 2 to 5 of the identifier are the host's and the lower half of the process's number (observed with
   Fast DDS 2.14, `GuidUtils`); the process must be one of the ROS processes of the observed host.
2. the name on the command line, `__node:=NAME`, with `__ns:=` if given.
3. the program's own name, `controller.py` or `controller_server`, if only one process has it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Final

from robot_offload.survey.snapshot import GraphSnapshot, NodeSeen, ProcessSeen

FAST_DDS: Final = "010f"
"""The vendor's number at the beginning of an identifier."""
CONTAINERS: Final = ("component_container", "component_container_mt", "component_container_isolated")


@dataclass(frozen=True, slots=True)
class Owners:
    """The assignment of nodes to processes.

    Attributes:
        process: node -> its process, if known.
        shares: node -> how many nodes its process runs.
        whole: node -> the node of which it is a part; itself for most.
    """

    process: Mapping[str, ProcessSeen]
    shares: Mapping[str, int]
    whole: Mapping[str, str]

    def cpu(self, node: str) -> float:
        """Return the node's share of its process's processor use; 0 if the process is unknown."""
        process = self.process.get(node)
        return process.cpu / self.shares[node] if process else 0.0

    def memory(self, node: str) -> int:
        """Return the node's share of its process's memory, bytes."""
        process = self.process.get(node)
        return process.memory // self.shares[node] if process else 0


def owners(graph: GraphSnapshot) -> Owners:
    """Return which process runs which node of a graph."""
    found = {node.name: it for node in graph.nodes if (it := _process_of(node, graph.participant, graph.processes))}
    members: dict[int, list[NodeSeen]] = {}
    for node in graph.nodes:
        if node.name in found:
            members.setdefault(found[node.name].pid, []).append(node)
    whole = {node.name: node.name for node in graph.nodes}
    for inside in members.values():
        whole |= _parts(found[inside[0].name], inside)
    shares = {name: len({whole[it.name] for it in members[process.pid]}) for name, process in found.items()}
    return Owners(found, shares, whole)


def _parts(process: ProcessSeen, nodes: list[NodeSeen]) -> dict[str, str]:
    """Return the wholes of a process's deeper nodes, if it runs several nodes and is not a container of components.

    Nav2's costmaps are such nodes: children of controller_server, in its process, and nothing without it.
    """
    if len(nodes) < 2 or program(process) in CONTAINERS:
        return {}
    first = min(nodes, key=lambda node: (not node.managed, node.name.count("/"), len(node.name), node.name))
    depth = first.name.count("/")
    return {node.name: first.name for node in nodes if node.name.count("/") > depth}


def program(process: ProcessSeen) -> str:
    """Return the file name of a process's program, or of the script that an interpreter runs."""
    words = [PurePosixPath(word).name for word in process.command]
    if words and words[0].startswith("python") and len(words) > 1:
        return words[1]
    return words[0] if words else ""


def _process_of(node: NodeSeen, looker: str, processes: Iterable[ProcessSeen]) -> ProcessSeen | None:
    processes = list(processes)
    by_identifier = [it for it in processes if any(_made_by(it, looker, each) for each in node.participants)]
    by_name = [it for it in processes if _named(it, node.name)]
    by_program = [it for it in processes if program(it).rpartition(".")[0] == _last(node.name)
                  or program(it) == _last(node.name)]  # fmt: skip
    for candidates in (by_identifier, by_name, by_program):
        if len(candidates) == 1:
            return candidates[0]
        both = [it for it in candidates if it in by_name or it in by_program]
        if len(both) == 1:
            return both[0]
    return None


def _made_by(process: ProcessSeen, looker: str, participant: str) -> bool:
    """Return whether a participant of Fast DDS on the looker's host has the process's number."""
    if not participant.startswith(FAST_DDS) or participant[4:8] != looker[4:8]:
        return False
    number = (process.inner_pid or process.pid) & 0xFFFF
    return participant[8:12] == number.to_bytes(2, "little").hex()


def _named(process: ProcessSeen, node: str) -> bool:
    namespace, _, name = node.rpartition("/")
    given = {word.rpartition(":__")[2] for word in process.command if ":=" in word}
    given |= {word.removeprefix("__") for word in process.command}
    names = {it.removeprefix("node:=") for it in given if it.startswith("node:=")}
    spaces = {it.removeprefix("ns:=").rstrip("/") for it in given if it.startswith("ns:=")}
    return name in names and (not spaces or namespace in spaces)


def _last(name: str) -> str:
    return name.rpartition("/")[2]


def ros_arguments(process: ProcessSeen) -> tuple[list[str], list[tuple[str, str]]]:
    """Return the command before the ROS arguments, and the remappings and parameters as (option, value)."""
    command = list(process.command)
    if "--ros-args" not in command:
        return command, []
    at = command.index("--ros-args")
    pairs = [(a, b) for a, b in pairwise(command[at + 1 :]) if a in ("-r", "--remap", "-p", "--param")]
    return command[:at], [("remap" if a in ("-r", "--remap") else "param", b) for a, b in pairs]
