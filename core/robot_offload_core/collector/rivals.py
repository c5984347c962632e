"""Who else publishes on the public topics of the collected outputs: in front of the consumers stands nobody but us.

By endpoint, not by the name of its node: a second collector has the same name. Endpoints of a process that was killed
stay in the graph until their participant's lease is over, so the ones of an earlier collector are given that time.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

PARTICIPANT_LEASE_S = 25.0
"""Fast DDS forgets a participant that was killed after 20 s."""
NAME_S = 1.5
"""How long the name of an endpoint's node may be on its way: discovery on one host."""


@dataclass(frozen=True)
class Endpoint:
    """A publisher as the graph shows it.

    Attributes:
        identity: unique in the graph (GID).
        node: full name of its node; "" while it is not known.
    """

    identity: bytes
    node: str


@dataclass
class Rivals:
    """Judges the publishers of one public topic, at each look at the graph.

    Attributes:
        own_node: full name of our own node.
        seen_s: when each endpoint was first seen.
    """

    own_node: str
    seen_s: dict[bytes, float] = field(default_factory=dict)

    def look(self, found: Iterable[Endpoint], publishers: int, now_s: float) -> list[str]:
        """Return the nodes of the publishers that are not ours, sorted.

        Args:
            found: all publishers of the topic.
            publishers: how many of them are ours.
            now_s: the steady clock.
        """
        endpoints = list(found)
        self.seen_s = {one.identity: self.seen_s.get(one.identity, now_s) for one in endpoints}
        others = {one.node for one in endpoints if one.node not in ("", self.own_node)}
        if any(not one.node and now_s - self.seen_s[one.identity] > NAME_S for one in endpoints):
            others.add("a node without a name")
        lasting = [one for one in endpoints if one.node == self.own_node and self._lasts(one, now_s)]
        if len(lasting) > publishers:
            others.add(f"a second {self.own_node}")
        return sorted(others)

    def _lasts(self, one: Endpoint, now_s: float) -> bool:
        return now_s - self.seen_s[one.identity] > PARTICIPANT_LEASE_S
