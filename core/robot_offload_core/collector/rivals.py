"""Find other publishers on the public topics of the collected outputs; only the collector may publish there.

Publishers are told apart by endpoint, not by node name: a second collector has the same name. Endpoints of a killed
process stay in the graph until their participant's lease is over, so those of an earlier collector are tolerated that
long. All of them are there at our first look: one that appears later belongs to a living process.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from robot_offload_core.words.reasons import Reason

PARTICIPANT_LEASE_S = 25.0
"""Fast DDS forgets a participant that was killed after 20 s."""
NAME_S = 1.5
"""Time for discovery on one host: an endpoint older than our start, or the name of its node, may arrive this late."""
REPLACED_S = 0.4
"""How long a replaced publisher of ours may still be seen beside the new one."""


@dataclass(frozen=True)
class Endpoint:
    """A publisher as the graph shows it.

    Attributes:
        identity: unique in the graph (GID).
        node: full name of its node; "" while unknown.
    """

    identity: bytes
    node: str


@dataclass
class Rivals:
    """Judges the publishers of one public topic, at each look at the graph.

    Attributes:
        own_node: full name of our own node.
        seen_s: when each endpoint was first seen.
        late: endpoints that appeared when no endpoint of ours or of a predecessor was expected any more.
        began_s: time of the first look; None before it.
    """

    own_node: str
    seen_s: dict[bytes, float] = field(default_factory=dict)
    late: set[bytes] = field(default_factory=set)
    began_s: float | None = None

    def look(self, found: Iterable[Endpoint], publishers: int, now_s: float, made_s: float = 0.0) -> list[str]:
        """Return the nodes of the publishers that are not ours, sorted.

        Args:
            found: all publishers of the topic.
            publishers: how many of them are ours.
            now_s: the steady clock.
            made_s: when the newest one of ours was made.
        """
        endpoints = list(found)
        self._note(endpoints, now_s, made_s)
        others = {one.node for one in endpoints if one.node not in ("", self.own_node)}
        if any(not one.node and now_s - self.seen_s[one.identity] > NAME_S for one in endpoints):
            others.add("a node without a name")
        own_name = [one.identity for one in endpoints if one.node == self.own_node]
        early = [identity for identity in own_name if identity not in self.late]
        late = [i for i in own_name if i in self.late and now_s - self.seen_s[i] > REPLACED_S]
        lasting = sum(now_s - self.seen_s[identity] > PARTICIPANT_LEASE_S for identity in early)
        # At least as many early ones are alive as we have made; the others may be leftovers, but not for long.
        if max(lasting, min(len(early), publishers)) + len(late) > publishers:
            others.add(f"a second {self.own_node}")
        return sorted(others)

    def _note(self, endpoints: list[Endpoint], now_s: float, made_s: float) -> None:
        """Record new endpoints, and whether they came late."""
        self.began_s = now_s if self.began_s is None else self.began_s
        new = {one.identity for one in endpoints} - self.seen_s.keys()
        if now_s - max(self.began_s, made_s) > NAME_S:
            self.late |= new
        self.seen_s = {one.identity: self.seen_s.get(one.identity, now_s) for one in endpoints}
        self.late &= self.seen_s.keys()


PARTICIPANT_BYTES = 12
"""The beginning of a DDS GID names its participant: two publishers of one process are one producer."""


@dataclass
class Twins:
    """Judges the publishers of one private topic, at each look at the graph: one process is to produce an output.

    A process that was killed and restarted is seen twice until its old participant's lease is over.

    Attributes:
        own_node: full name of our own node, which fills the private topics of shared outputs.
        seen_s: when each participant was first seen.
    """

    own_node: str
    seen_s: dict[bytes, float] = field(default_factory=dict)

    def look(self, found: Iterable[Endpoint], now_s: float) -> list[str]:
        """Return the nodes of the lasting processes, sorted, if there are several; otherwise an empty list."""
        nodes = {one.identity[:PARTICIPANT_BYTES]: one.node for one in found if one.node != self.own_node}
        self.seen_s = {process: self.seen_s.get(process, now_s) for process in nodes}
        lasting = [nodes[process] for process, seen_s in self.seen_s.items() if now_s - seen_s > PARTICIPANT_LEASE_S]
        return sorted(lasting) if len(lasting) > 1 else []


def twins_problem(topic: str, nodes: list[str]) -> tuple[str, str] | None:
    """Return the problem, (reason, message), of a private topic with several producers; None for one or none."""
    if not nodes:
        return None
    message = f"{topic} is published by {len(nodes)} processes ({', '.join(nodes)}); end all but one"
    return Reason.TWO_REPLICAS.value, message
