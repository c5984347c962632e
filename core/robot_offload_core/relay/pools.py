"""The cloud relay's part for pools: which pod of a node with several replicas takes the next call.

The pod with the fewest open calls takes it; of several, the one that has waited longest. A pod that was ordered to end
gets no new calls and finishes its own. If a pod is lost, its calls begin anew only where a service may be asked twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from robot_offload_core.relay.goals.ports import CloudRelayPorts
from robot_offload_core.words.declared import ServiceMode, ServiceSpec

SILENT_S = 5.0
"""A pod that let a call time out is asked after all others for this long; then it gets another chance."""


@dataclass(frozen=True)
class PooledCall:
    """An open call. `until_s`: end of its caller's wait."""

    service: str
    member: str
    payload: bytes
    until_s: float


class Pools:
    """The pods of all pools, and their open calls.

    Attributes:
        services: those that pools serve, by public name.
        servers: endpoints by (service, member), as the graph shows them.
        leaving: members whose pods were ordered to end.
        calls: open ones, by key.
        silent: until when a member is asked last.
        turns: number of the newest call of each member.
    """

    def __init__(self, services: Collection[ServiceSpec], ports: CloudRelayPorts, counters: Counter[str]) -> None:
        self.ports = ports
        self.counters = counters
        self.services = {spec.name: spec for spec in services if spec.pooled}
        self.servers: dict[tuple[str, str], str] = {}
        self.leaving: frozenset[str] = frozenset()
        self.calls: dict[int, PooledCall] = {}
        self.silent: dict[str, float] = {}
        self.turns: dict[str, int] = {}
        self.turn_number = 0

    # -- who takes a call ---------------------------------------------------------------------------------------------

    def open(self, member: str) -> int:
        """Return how many calls a member has."""
        return sum(1 for call in self.calls.values() if call.member == member)

    def up(self) -> set[str]:
        """Return the services that are served. A leaving pod's services count: a call waits for the next pod."""
        return {service for service, _ in self.servers}

    def choose(self, service: str) -> str | None:
        """Return the member that takes the next call; None if there is none."""
        now_s = self.ports.now_s()
        members = [member for name, member in self.servers if name == service and member not in self.leaving]
        return min(
            members,
            key=lambda it: (self.silent.get(it, 0.0) > now_s, self.open(it), self.turns.get(it, 0), it),
            default=None,
        )

    def call(self, service: str, key: int, payload: bytes) -> bool:
        """Pass a call to a member; return whether there was one."""
        return self._begin(service, key, payload, self.ports.now_s() + self.services[service].timeout_s)

    def _begin(self, service: str, key: int, payload: bytes, until_s: float) -> bool:
        member = self.choose(service)
        if member is None:
            return False
        self.turn_number += 1
        self.turns[member] = self.turn_number
        self.calls[key] = PooledCall(service, member, payload, until_s)
        self.ports.call_member(service, member, key, payload)
        return True

    # -- what happens -------------------------------------------------------------------------------------------------

    def seen(self, service: str, members: Mapping[str, str]) -> None:
        """Take the members of a service in the graph, with their endpoints; a member that changed was replaced."""
        before = {member: endpoints for (name, member), endpoints in self.servers.items() if name == service}
        self.servers = {place: endpoints for place, endpoints in self.servers.items() if place[0] != service}
        self.servers |= {(service, member): endpoints for member, endpoints in members.items()}
        for member, endpoints in before.items():
            if members.get(member) != endpoints:
                self._lost(service, member)
        known = {member for _, member in self.servers}
        self.silent = {member: until_s for member, until_s in self.silent.items() if member in known}
        self.turns = {member: number for member, number in self.turns.items() if member in known}

    def _lost(self, service: str, member: str) -> None:
        """Begin a lost member's calls anew where they may be executed twice."""
        now_s = self.ports.now_s()
        lost = [(key, it) for key, it in self.calls.items() if (it.service, it.member) == (service, member)]
        for key, call in lost:
            del self.calls[key]
            self.ports.forget_call(key)
            again = self.services[service].mode is ServiceMode.IDEMPOTENT and now_s < call.until_s
            if again and self._begin(service, key, call.payload, call.until_s):
                self.counters[f"{service}.again"] += 1
            else:
                self.counters[f"{service}.lost"] += 1

    def leave(self, members: Collection[str]) -> tuple[str, ...]:
        """Take the members whose pods were ordered to end; return those that have no open call."""
        self.leaving = frozenset(members)
        return tuple(sorted(member for member in members if not self.open(member)))

    def answered(self, key: int) -> None:
        """Record an answer: its member is not silent."""
        call = self.calls.pop(key, None)
        if call is not None:
            self.silent.pop(call.member, None)

    def forget(self) -> None:
        """Drop all calls: another relay of the robot asks now."""
        self.calls.clear()

    # -- levels -------------------------------------------------------------------------------------------------------

    def turn(self) -> None:
        """Mark members that let a call time out as silent; a late answer is still passed on."""
        now_s = self.ports.now_s()
        for key, call in list(self.calls.items()):
            if now_s >= call.until_s:
                del self.calls[key]
                self.silent[call.member] = now_s + SILENT_S
                self.counters[f"{call.service}.ran_out"] += 1

    def due_s(self) -> float:
        """Return when `turn` has something to do."""
        return min((call.until_s for call in self.calls.values()), default=float("inf"))
