"""A robot's graph as a problem of cuts: what each node costs, what each topic carries, what the link bears. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import networkx as nx

TIE: float = 1e-12
"""Of cuts that save the same, the one with fewer bytes on the link is better: in cores a byte per second."""


@dataclass(frozen=True)
class Part:
    """A node.

    Attributes:
        cpu: its use of the processor, 1.0 is one core.
        movable: whether it can leave the robot.
        period_s: seconds between two of its outputs; 0: unknown.
    """

    name: str
    cpu: float
    movable: bool = False
    period_s: float = 0.0


@dataclass(frozen=True)
class Flow:
    """What one publisher sends on one topic.

    Attributes:
        commands: whether what moves the robot hears it, so that a loop ends here.
    """

    topic: str
    publisher: str
    hearers: tuple[str, ...]
    bytes_per_s: float
    message_size: float = 0.0
    commands: bool = False


@dataclass(frozen=True)
class Link:
    """What the link bears: bytes per second both ways together (Wi-Fi shares them), seconds there and back."""

    bandwidth: float
    rtt_s: float


@dataclass(frozen=True)
class LatencyLoop:
    """The slowest way from a sensor to a command: t_l + t_c_cloud <= t_c_robot + tolerance.

    Attributes:
        link_s: t_l, what the crossings of the link take.
        gained_s: t_c_robot - t_c_cloud of the nodes on it that have moved.
    """

    topic: str
    link_s: float
    gained_s: float

    def allowed(self, tolerance_s: float) -> bool:
        """Whether the loop through the cloud is as good as the rule wants."""
        return self.link_s - self.gained_s <= tolerance_s + 1e-9


@dataclass(frozen=True)
class Problem:
    """Everything that decides about a cut.

    Attributes:
        speedup: how much shorter the periods of nodes are in the cloud; 1: the same.
    """

    parts: Mapping[str, Part]
    flows: tuple[Flow, ...]
    link: Link
    tolerance_s: float
    speedup: float = 1.0

    @cached_property
    def movable(self) -> tuple[str, ...]:
        """The nodes that can move, the most expensive first."""
        return tuple(sorted((it.name for it in self.parts.values() if it.movable),
                            key=lambda name: (-self.parts[name].cpu, name)))  # fmt: skip

    def saved(self, moved: Collection[str]) -> float:
        """Returns the processor time that leaves the robot."""
        return sum(self.parts[name].cpu for name in moved)

    def crossing(self, moved: Collection[str]) -> Iterator[Flow]:
        """Yields the flows that cross the link, each once however many hear it."""
        for flow in self.flows:
            if any((it in moved) != (flow.publisher in moved) for it in flow.hearers):
                yield flow

    def bytes_per_s(self, moved: Collection[str]) -> float:
        """Returns what the link carries."""
        return sum(flow.bytes_per_s for flow in self.crossing(moved))

    def value(self, moved: Collection[str]) -> float:
        """Returns what a cut is worth: what it saves, and next to nothing for what it sends."""
        return self.saved(moved) - TIE * self.bytes_per_s(moved)

    def loops(self, moved: Collection[str]) -> list[LatencyLoop]:
        """Returns the slowest way to each command, over every way from what is bound to the robot."""
        ways = _ways(self, moved)
        found = []
        for flow in self.flows:
            if flow.commands:
                link_s, gained_s = ways[flow.publisher]
                found.append(
                    LatencyLoop(flow.topic, link_s + (self._hop(flow) if flow.publisher in moved else 0.0), gained_s)
                )
        return found

    def feasible(self, moved: Collection[str]) -> bool:
        """Whether the link bears a cut and every loop stays within the rule."""
        if self.bytes_per_s(moved) > self.link.bandwidth:
            return False
        return all(loop.allowed(self.tolerance_s) for loop in self.loops(moved))

    def _hop(self, flow: Flow) -> float:
        return self.link.rtt_s / 2 + flow.message_size / self.link.bandwidth


def _ways(problem: Problem, moved: Collection[str]) -> dict[str, tuple[float, float]]:
    """Returns, for each node, the (seconds on the link, seconds gained) of the slowest way to it.

    Loops through the world are cut where they enter the robot: nobody waits for what a node that is bound hears. Nodes
    in a circle count as one, with two crossings for each of the smaller side where the circle is divided.
    """
    graph = nx.DiGraph()
    graph.add_nodes_from(problem.parts)
    for flow in problem.flows:
        for hearer in flow.hearers:
            if hearer != flow.publisher and problem.parts[hearer].movable:
                hop = problem._hop(flow) if (hearer in moved) != (flow.publisher in moved) else 0.0
                before = graph.get_edge_data(flow.publisher, hearer, {"hop": 0.0})["hop"]
                graph.add_edge(flow.publisher, hearer, hop=max(hop, before))
    groups = nx.condensation(graph)
    slowest: dict[int, tuple[float, float]] = {}
    for group in nx.topological_sort(groups):
        members = groups.nodes[group]["members"]
        ways = [(0.0, 0.0)]
        for member in members:
            for before, _, data in graph.in_edges(member, data=True):
                if before not in members:
                    link_s, gained_s = slowest[groups.graph["mapping"][before]]
                    ways.append((link_s + data["hop"], gained_s))
        inside = [it for it in members if it in moved]
        turns = min(len(inside), len(members) - len(inside)) * problem.link.rtt_s
        gained = sum(problem.parts[it].period_s * (1 - 1 / problem.speedup) for it in inside)
        link_s, gained_s = max(ways, key=lambda way: (way[0] - way[1], way))
        slowest[group] = (link_s + turns, gained_s + gained)
    return {name: slowest[groups.graph["mapping"][name]] for name in problem.parts}
