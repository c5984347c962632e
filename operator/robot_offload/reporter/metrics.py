"""The agent's state as Prometheus metrics, made anew at each scrape: nothing is kept but what was counted here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

from robot_offload.api.agent_state import AgentState, Sight

SITES: Final = ("robot", "cloud", "unknown")


@dataclass(slots=True)
class Counts:
    """What this process has counted since it started."""

    lease_writes: int = 0
    lease_failures: int = 0
    handovers: int = 0
    streams_refused: int = 0
    streams_dropped: int = 0


def exposition(sight: Sight, counts: Counts, now_s: float) -> bytes:
    """Returns the page that `/metrics` serves.

    Args:
        sight: the agent's state as last seen.
        counts: what was counted here.
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
    yield _gauge("robot_offload_agent_alive", "1 while the cloud agent writes its state.", fresh)
    if sight.state is not None:
        yield _gauge(
            "robot_offload_agent_state_age_seconds", "Age of the agent's last state.", max(0.0, sight.age_s(now_s))
        )
    if sight.state is not None and fresh:
        yield from _live(sight.state)
    yield CounterMetricFamily(
        "robot_offload_lease_writes", "Writes of the robot's Lease that succeeded.", value=counts.lease_writes
    )
    yield CounterMetricFamily(
        "robot_offload_lease_failures", "Writes of the robot's Lease that failed.", value=counts.lease_failures
    )
    yield CounterMetricFamily(
        "robot_offload_streams_refused", "Clients of the stream that found it full.", value=counts.streams_refused
    )
    yield CounterMetricFamily(
        "robot_offload_streams_dropped", "Clients of the stream that were too slow.", value=counts.streams_dropped
    )
    yield CounterMetricFamily(
        "robot_offload_handovers", "Handovers that pods have asked for before they stop.", value=counts.handovers
    )


def _live(state: AgentState) -> Iterator[Metric]:
    """Yields what only a living agent can vouch for; a silent one leaves gaps in the graphs instead of old numbers."""
    yield _gauge("robot_offload_robot_connected", "1 while the robot is connected.", state.connected)
    yield _gauge("robot_offload_agent_ready", "1 while the cloud agent listens for its robot.", state.ready)
    yield _gauge("robot_offload_epoch", "Number of the present changeover.", state.epoch)
    placement = GaugeMetricFamily("robot_offload_placement", "1 for the side that acts.", labels=["site"])
    for site in SITES:
        placement.add_metric([site], float(state.site == site))
    yield placement
    round_trip = GaugeMetricFamily(
        "robot_offload_round_trip_seconds", "Round trip of the heartbeats, by quantile.", labels=["quantile"]
    )
    for quantile, value_ms in (("0.5", state.round_trip_p50_ms), ("0.99", state.round_trip_p99_ms)):
        if value_ms is not None and math.isfinite(value_ms):
            round_trip.add_metric([quantile], value_ms / 1e3)
    yield round_trip
    carried = CounterMetricFamily(
        "robot_offload_topic_bytes", "Bytes that crossed the link since the agent's start.", labels=["topic"]
    )
    for topic, count in state.carried:
        carried.add_metric([topic], float(count))
    yield carried
    ages = GaugeMetricFamily(
        "robot_offload_state_age_at_change_seconds",
        "How old the state was with which the cloud's nodes went on when the cloud last began to act.",
        labels=["state"],
    )
    for name, age_ms in state.state_ages_ms:
        ages.add_metric([name], age_ms / 1e3)
    yield ages
    nodes = GaugeMetricFamily("robot_offload_node_state", "1 for each node's present state.", labels=["node", "state"])
    for name, lifecycle in state.nodes:
        nodes.add_metric([name, lifecycle], 1.0)
    yield nodes
    yield _gauge(
        "robot_offload_agent_generation", "Generation the cloud agent was started with.", state.agent_generation
    )
    if state.settings.robot_generation is not None:
        yield _gauge(
            "robot_offload_robot_generation", "Generation that the robot runs.", state.settings.robot_generation
        )
    if state.settings.accepted is not None:
        yield _gauge(
            "robot_offload_settings_accepted", "1 when the robot took the last settings.", state.settings.accepted
        )


def _gauge(name: str, text: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, text, value=float(value))
