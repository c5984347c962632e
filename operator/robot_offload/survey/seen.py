"""A graph with all that is known and decided about its nodes: the source of the rest of a proposal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from robot_offload.survey.owners import Owners
from robot_offload.survey.roles import COMMANDS, Kind, Role
from robot_offload.survey.snapshot import GraphSnapshot, NodeSeen, TopicSeen


@dataclass(frozen=True, slots=True)
class World:
    """The source of a proposal.

    Attributes:
        graph, owned, roles: as seen.
        namespace: of the robot.
        moved: full name of a node -> Duplicated or Cloud; all others stay on the robot.
        folder: of the future file; empty: unknown.
    """

    graph: GraphSnapshot
    owned: Owners
    roles: Mapping[str, Role]
    namespace: str
    moved: dict[str, str]
    folder: str = ""

    def publishers(self, topic: TopicSeen) -> list[str]:
        """Return the nodes that publish a topic, parts by their whole."""
        return sorted({self._whole(it.node) for it in topic.publishers if self._counts(it.node)})

    def subscribers(self, topic: TopicSeen) -> list[str]:
        """Return the nodes that hear a topic, parts by their whole."""
        return sorted({self._whole(it.node) for it in topic.subscribers if self._counts(it.node)})

    def members(self, node: str) -> Iterator[NodeSeen]:
        """Yield a node and its parts."""
        return (it for it in self.graph.nodes if self._whole(it.name) == node)

    def servers(self, kind: str) -> dict[str, list[str]]:
        """Return who offers each service (or calls it, for `clients`): name -> nodes, for one field of a node."""
        found: dict[str, list[str]] = {}
        for node in self.graph.nodes:
            if self._counts(node.name):
                for name in getattr(node, kind):
                    found.setdefault(name, []).append(self._whole(node.name))
        return found

    def core(self, node: str) -> bool:
        """Return whether a leaving node commands what moves the robot."""
        if self.moved.get(node) != "Duplicated":
            return False
        commands = [it for it in self.graph.topics if it.type in COMMANDS and node in self.publishers(it)]
        return any(set(self.subscribers(it)) - set(self.moved) for it in commands)

    def neighbours(self) -> set[str]:
        """Return the robot's nodes that share a topic with a leaving one."""
        found: set[str] = set()
        for topic in self.graph.topics:
            ends = {*self.publishers(topic), *self.subscribers(topic)}
            if ends & set(self.moved):
                found |= ends
        return found

    def _whole(self, node: str) -> str:
        return self.owned.whole.get(node, node)

    def _counts(self, node: str) -> bool:
        role = self.roles.get(node)
        return role is None or role.kind is not Kind.OURS
