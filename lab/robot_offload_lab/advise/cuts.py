"""The best cuts of a graph: branch and bound over minimum cuts.

Without the limits of the link the best cut is a minimum cut between robot and cloud. The bandwidth enters with a price
on each byte: for every price >= 0 the minimum cut bounds what any cut within the bandwidth can save (Lagrange).
Branching on the most expensive node that is not decided yet closes what the bound leaves open. A topic is one edge,
however many hear it (an auxiliary vertex a direction).
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass
from typing import Final

import networkx as nx

from robot_offload_lab.advise.model import TIE, Problem

MOST_BOUNDS: Final = 3000
"""Minimum cuts that are worked out before the search ends with the best that it has: enough for all cuts of 9 nodes."""
PRICES: Final = (0.0, 0.25, 1.0, 4.0)
"""Prices that are tried, in units of all processor time for the whole bandwidth."""
_ROBOT: Final = ("side", "robot")
_CLOUD: Final = ("side", "cloud")


@dataclass(frozen=True)
class Advice:
    """What was found.

    Attributes:
        cuts: sets of nodes that leave, the best first; empty: nothing can.
        proven: whether no better cut exists; otherwise the search ended early.
    """

    cuts: tuple[frozenset[str], ...]
    proven: bool


def best_cuts(problem: Problem, count: int = 3) -> Advice:
    """Returns the best cuts of a graph that the link bears, each of at least one node."""
    found: dict[frozenset[str], float] = {}
    number = itertools.count()
    first: tuple[float, int, frozenset[str], frozenset[str]] = (-float("inf"), next(number), frozenset(), frozenset())
    queue, bounds = [first], 0
    while queue:
        bound, _, leaving, staying = heapq.heappop(queue)
        if len(found) >= count and -bound <= _worst(found, count) + 1e-12:
            break
        if bounds >= MOST_BOUNDS:
            return Advice(_ranked(problem, found, count), proven=False)
        left = [name for name in problem.movable if name not in leaving and name not in staying]
        limit = float("inf")
        for price in PRICES if left else PRICES[:1]:
            worth, moved = _bounded(problem, leaving, staying, price)
            bounds += 1
            limit = min(limit, worth)
            if moved and moved not in found and problem.feasible(moved):
                found[moved] = problem.value(moved)
        if not left or (len(found) >= count and limit <= _worst(found, count) + 1e-12):
            continue
        name = left[0]
        heapq.heappush(queue, (-limit, next(number), leaving | {name}, staying))
        heapq.heappush(queue, (-limit, next(number), leaving, staying | {name}))
    return Advice(_ranked(problem, found, count), proven=True)


def _worst(found: dict[frozenset[str], float], count: int) -> float:
    return sorted(found.values(), reverse=True)[count - 1]


def _ranked(problem: Problem, found: dict[frozenset[str], float], count: int) -> tuple[frozenset[str], ...]:
    order = sorted(found, key=lambda it: (-found[it], problem.bytes_per_s(it), len(it), sorted(it)))
    return tuple(order[:count])


def _bounded(
    problem: Problem, leaving: frozenset[str], staying: frozenset[str], price: float
) -> tuple[float, frozenset[str]]:
    """Returns what no cut with these decisions can exceed, and the cut that is best at this price of a byte."""
    everything = problem.saved(problem.movable)
    bandwidth = problem.link.bandwidth
    each = TIE + (price * everything / bandwidth if bandwidth > 0 else 0.0)
    graph = nx.DiGraph()
    graph.add_nodes_from((_ROBOT, _CLOUD))
    for part in problem.parts.values():
        if not part.movable or part.name in staying:
            graph.add_edge(_ROBOT, part.name)  # no capacity: never cut
        elif part.name in leaving:
            graph.add_edge(part.name, _CLOUD)
        else:
            graph.add_edge(part.name, _CLOUD, capacity=part.cpu)
    for at, flow in enumerate(problem.flows):
        weight = each * flow.bytes_per_s
        graph.add_edge(flow.publisher, ("up", at), capacity=weight)
        graph.add_edge(("down", at), flow.publisher, capacity=weight)
        for hearer in flow.hearers:
            graph.add_edge(("up", at), hearer)
            graph.add_edge(hearer, ("down", at))
    cost, (robot, _) = nx.minimum_cut(graph, _ROBOT, _CLOUD)
    moved = frozenset(name for name in problem.movable if name not in robot)
    return everything - cost + (each - TIE) * bandwidth, moved
