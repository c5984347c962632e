"""From a graph that was looked at to a problem of cuts: who can move and as what, what each topic carries."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from robot_offload.survey.owners import owners
from robot_offload.survey.roles import COMMANDS, Kind, roles
from robot_offload.survey.seen import World
from robot_offload.survey.snapshot import GraphSnapshot
from robot_offload_lab.advise.model import Flow, Link, Part, Problem


@dataclass(frozen=True)
class Asked:
    """A graph as a problem, and as what each node that can move would leave: Duplicated or Cloud."""

    problem: Problem
    placements: dict[str, str]


def asked(graph: GraphSnapshot, link: Link, tolerance_s: float, speedup: float) -> Asked:
    """Returns the problem of a graph.

    A node with a lifecycle leaves as Duplicated: asleep on the robot while the cloud acts. One without can only leave
    as Cloud, for then it costs the robot nothing; so it stays when a command depends on it, and when it serves or calls
    a node that would be duplicated.
    """
    owned = owners(graph)
    world = World(graph, owned, roles(graph, owned), "", {})
    names = sorted({owned.whole[node.name] for node in graph.nodes if world.roles[node.name].kind is not Kind.OURS})
    free = {node.name for node in graph.nodes if world.roles[node.name].kind is Kind.FREE and not node.twice}
    managed = {node.name for node in graph.nodes if node.managed}
    flows = [it for it in _flows(world) if it.publisher in names]
    before = _upstream(flows)
    joined = _joined(world, managed & free)
    placements = {
        name: "Duplicated" if name in managed else "Cloud"
        for name in names
        if name in free and (name in managed or (name not in before and name not in joined))
    }
    periods = {flow.publisher: 1 / rate for flow, rate in _rates(world, flows) if rate > 0}
    parts = {
        name: Part(name, sum(owned.cpu(it.name) for it in list(world.members(name))[:1]), name in placements,
                   periods.get(name, 0.0))
        for name in names
    }  # fmt: skip
    known = tuple(dataclasses.replace(it, hearers=tuple(name for name in it.hearers if name in parts)) for it in flows)
    return Asked(Problem(parts, known, link, tolerance_s, speedup), placements)


def _flows(world: World) -> list[Flow]:
    found = []
    for topic in world.graph.topics:
        publishers, hearers = world.publishers(topic), world.subscribers(topic)
        ends = [it for it in hearers if (role := world.roles.get(it)) is not None and role.kind is Kind.BOUND]
        found += [
            Flow(topic.name, name, tuple(it for it in hearers if it != name), topic.bytes_per_s / len(publishers),
                 topic.message_size, topic.type in COMMANDS and bool(ends))
            for name in publishers
        ]  # fmt: skip
    return found


def _rates(world: World, flows: list[Flow]) -> list[tuple[Flow, float]]:
    rates = {topic.name: topic.rate_hz for topic in world.graph.topics}
    return sorted(((flow, rates[flow.topic]) for flow in flows), key=lambda it: (it[0].commands, -it[1]))


def _upstream(flows: list[Flow]) -> set[str]:
    """Returns the nodes from which a way leads to a command."""
    found = {flow.publisher for flow in flows if flow.commands}
    while more := {flow.publisher for flow in flows if found & set(flow.hearers)} - found:
        found |= more
    return found


def _joined(world: World, duplicated: set[str]) -> set[str]:
    """Returns the nodes that share a service or an action with one that would be duplicated."""
    found: set[str] = set()
    for serving, calling in (("services", "clients"), ("actions", "action_clients")):
        offered, called = world.servers(serving), world.servers(calling)
        for name in set(offered) & set(called):
            ends = {*offered[name], *called[name]}
            if ends & duplicated:
                found |= ends
    return found
