"""The agent's state as Prometheus metrics, built at each scrape: only this process's own counts are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from prometheus_client import CollectorRegistry
from prometheus_client.core import Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

from robot_offload.api.agent_state import AgentState, Sight
from robot_offload.api.side_numbers import FATES, GAP_S, IN_FLIGHT, LATENCY_S, OUTCOMES, SideNumbers
from robot_offload.reporter import families
from robot_offload.reporter.families import Family, add

SITES: Final = ("robot", "cloud", "unknown")


@dataclass(slots=True)
class Counts:
    """The counts of this process since its start."""

    lease_writes: int = 0
    lease_failures: int = 0
    handovers: int = 0
    streams_refused: int = 0
    streams_dropped: int = 0


def exposition(sight: Sight, counts: Counts, now_s: float) -> bytes:
    """Return the page of `/metrics`.

    Args:
        sight: the agent's state as last seen.
        counts: of this process.
        now_s: the steady clock.
    """
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Page(tuple(_metrics(sight, counts, now_s))))
    return generate_latest(registry)


class _Page(Collector):
    def __init__(self, families: tuple[Metric, ...]) -> None:
        self._families = families

    def collect(self) -> Iterable[Metric]:
        return self._families


def _metrics(sight: Sight, counts: Counts, now_s: float) -> Iterator[Metric]:
    fresh = sight.fresh(now_s)
    yield families.ALIVE.one(fresh)
    if sight.state is not None:
        yield families.STATE_AGE.one(max(0.0, sight.age_s(now_s)))
    if sight.state is not None and fresh:
        yield from _live(sight.state)
        yield from _sides({"cloud": sight.state.cloud, "robot": sight.state.robot})
    yield families.LEASE_WRITES.one(counts.lease_writes)
    yield families.LEASE_FAILURES.one(counts.lease_failures)
    yield families.HANDOVERS.one(counts.handovers)
    yield families.STREAMS_REFUSED.one(counts.streams_refused)
    yield families.STREAMS_DROPPED.one(counts.streams_dropped)


def _live(state: AgentState) -> Iterator[Metric]:
    """Yield what only a living agent can confirm; for a silent one the graphs show gaps, not old numbers."""
    yield families.CONNECTED.one(state.connected)
    yield families.AGENT_READY.one(state.ready)
    yield families.EPOCH.one(state.epoch)
    yield _labelled(families.PLACEMENT, (((site,), float(state.site == site)) for site in SITES))
    trips = (("0.5", state.round_trip_p50_ms), ("0.99", state.round_trip_p99_ms))
    yield _labelled(
        families.ROUND_TRIP, (((at,), ms / 1e3) for at, ms in trips if ms is not None and math.isfinite(ms))
    )
    carried = [(("cloud", topic.topic, topic.direction), topic) for topic in state.carried]
    yield _labelled(families.TOPIC_BYTES, ((labels, topic.bytes) for labels, topic in carried))
    yield _labelled(families.TOPIC_MESSAGES, ((labels, topic.messages) for labels, topic in carried))
    robots = state.robot.states if state.robot is not None else ()
    ages = [("cloud", state.state_ages_ms), ("robot", robots)]
    yield _labelled(
        families.STATE_AT_CHANGE, (((side, name), age_ms / 1e3) for side, all_ms in ages for name, age_ms in all_ms)
    )
    yield _labelled(families.NODE_STATE, ((node, 1.0) for node in state.nodes))
    yield families.AGENT_GENERATION.one(state.agent_generation)
    if state.settings.robot_generation is not None:
        yield families.ROBOT_GENERATION.one(state.settings.robot_generation)
    if state.settings.accepted is not None:
        yield families.ACCEPTED.one(state.settings.accepted)
    yield families.ROBOT_REPORT.one(state.robot is not None)


def _sides(said: Mapping[str, SideNumbers | None]) -> Iterator[Metric]:
    """Yield each side's report about itself, with the label `side`."""
    known = {side: numbers for side, numbers in said.items() if numbers is not None}
    for family, value in _PLAIN:
        found = ((side, value(numbers)) for side, numbers in known.items())
        yield _labelled(family, (((side,), number) for side, number in found if number is not None))
    for family, entries in _TABLES:
        yield _labelled(
            family, (((side, *names), value) for side, numbers in known.items() for names, value in entries(numbers))
        )
    latency, gaps = families.LATENCY.histograms(), families.GAP.histograms()
    for side, numbers in known.items():
        if numbers.latency is not None:
            add(latency, [side], LATENCY_S, numbers.latency)
        for output, gap in numbers.gaps:
            add(gaps, [side, output], GAP_S, gap)
    yield latency
    yield gaps


_PLAIN: Final[tuple[tuple[Family, Callable[[SideNumbers], float | None]], ...]] = (
    (families.SIDE_READY, lambda numbers: numbers.ready),
    (families.LATENCY_NOW, lambda numbers: numbers.latency_s),
    (families.LOSS, lambda numbers: numbers.loss_share),
    (families.CLOCK_OFFSET, lambda numbers: numbers.clock_offset_s),
    (families.BEATS_RECEIVED, lambda numbers: numbers.beats_received),
    (families.BEATS_LOST, lambda numbers: numbers.beats_lost),
    (families.LOSSES, lambda numbers: numbers.losses),
    (families.FALSE_ALARMS, lambda numbers: numbers.false_alarms),
    (families.SILENCE, lambda numbers: numbers.silence_s),
    (families.GARBAGE, lambda numbers: numbers.garbage_reports),
    (families.LEFT_OUT, lambda numbers: numbers.left_out),
)
Entries = Iterable[tuple[tuple[str, ...], float]]


def _used(numbers: SideNumbers) -> Entries:
    counts = (("goal", numbers.used_goals), ("call", numbers.used_calls))
    return (((kind,), count) for kind, count in counts if count is not None)


_TABLES: Final[tuple[tuple[Family, Callable[[SideNumbers], Entries]], ...]] = (
    (families.CHANGEOVERS, lambda numbers: (((to, reason), count) for to, reason, count in numbers.changeovers)),
    (families.OVERDUE, lambda numbers: (((name,), seconds) for name, seconds in numbers.overdue_s)),
    (families.REFUSED, lambda numbers: (((reason,), count) for reason, count in numbers.refused)),
    (families.INPUT_MESSAGES, lambda numbers: _by_word(numbers.topics, FATES)),
    (families.GOALS, lambda numbers: _by_word(numbers.goals, OUTCOMES)),
    (families.OPEN_GOALS, lambda numbers: _by_word(((n, counts[:2]) for n, counts in numbers.actions), IN_FLIGHT[:2])),
    (families.GOAL_RESTARTS, lambda numbers: (((name,), restarts) for name, (*_, restarts) in numbers.actions)),
    (families.OPEN_CALLS, lambda numbers: (((name,), count) for name, count in numbers.services)),
    (families.OPEN_USED, _used),
    (families.CPU, lambda numbers: (((name,), cpu_ms / 1e3) for name, (cpu_ms, _, _) in numbers.processes)),
    (families.MEMORY, lambda numbers: (((name,), kilo * 1024) for name, (_, kilo, _) in numbers.processes)),
    (families.DEATHS, lambda numbers: (((name,), deaths) for name, (_, _, deaths) in numbers.processes)),
)


def _by_word(table: Iterable[tuple[str, tuple[int, ...]]], words: tuple[str, ...]) -> Entries:
    return (((name, word), count) for name, counts in table for word, count in zip(words, counts, strict=True))


def _labelled(family: Family, samples: Entries) -> Metric:
    """Return a metric with one value for each set of labels; of two equal ones the first counts."""
    found, known = family.empty(), set()
    for labels, value in samples:
        if labels not in known:
            known.add(labels)
            found.add_metric(list(labels), float(value))
    return found
