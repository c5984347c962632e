"""The ROS graph as `doctor` sees it on a robot: the publishers of topics that only the collector should publish.

The graph is read under the shell's own `python3`, because ROS 2 is there; this package needs no ROS.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload.cli.doctor.checks import Finding

DISCOVERY_S: Final = 3.0
"""How long discovery on this network may take; counted anew from each node that is found."""
LONGEST_S: Final = 30.0
"""Longest time for which a graph is watched in which nodes keep coming and going."""
_PROBE: Final = """
import json, sys, time
import rclpy
rclpy.init()
node = rclpy.create_node("robot_offload_doctor")
quiet_s, longest_s = map(float, sys.argv[1:3])
known, now = set(), time.monotonic()
end, last = now + quiet_s, now + longest_s
while now < min(end, last):
    rclpy.spin_once(node, timeout_sec=0.1)
    now, found = time.monotonic(), set(node.get_node_names_and_namespaces())
    if found != known:
        known, end = found, now + quiet_s
found = {topic: [f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in node.get_publishers_info_by_topic(topic)]
         for topic in sys.argv[3:]}
print(json.dumps(found))
"""  # noqa: E501 - a program, not prose
_LIMIT_S: Final = 90.0


@dataclass(frozen=True, slots=True)
class Graph:
    """The publishers found.

    Attributes:
        publishers: the nodes that publish each topic, one entry a publisher.
        problem: why the graph could not be read; empty: it was.
    """

    publishers: Mapping[str, Sequence[str]]
    problem: str = ""


def ask(topics: Sequence[str], python: str | None = None) -> Graph:
    """Find out who publishes `topics` in the ROS domain of this shell; this takes some seconds.

    Args:
        topics: full names.
        python: an interpreter that can import rclpy; None: the shell's python3.
    """
    program = python or shutil.which("python3")
    if program is None:
        return Graph({}, "there is no python3 on the PATH")
    command = [program, "-c", _PROBE, str(DISCOVERY_S), str(LONGEST_S), *topics]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Graph({}, f"ROS 2 did not answer within {_LIMIT_S:g} s")
    if done.returncode:
        return Graph({}, (done.stderr.strip().splitlines() or ["python3 failed"])[-1])
    return Graph(json.loads(done.stdout))


def judge(graph: Graph) -> Iterator[Finding]:
    """Yield topics that have publishers beside the collector. Pure."""
    if graph.problem:
        yield Finding(
            "Publishers",
            "unknown",
            f"the ROS graph cannot be asked: {graph.problem}",
            "Source the ROS 2 setup file in this shell, then run doctor again.",
        )
        return
    for topic, nodes in sorted(graph.publishers.items()):
        if len(nodes) > 1:
            yield Finding(
                "Publishers",
                "error",
                f"{topic} has {len(nodes)} publishers: {', '.join(sorted(nodes))}",
                "Only the collector may publish it: start your node with the remappings in the bundle's README.md.",
            )
        elif nodes:
            yield Finding("Publishers", "ok", f"{topic} is published by {nodes[0]} alone")
        else:
            yield Finding("Publishers", "ok", f"{topic} has no publisher at the moment")
