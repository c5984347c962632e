"""What the operator tells Prometheus: its own work, and the state of all objects in sums."""

from __future__ import annotations

from collections import Counter as Tally
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from robot_offload.api.v1alpha1.status import CONDITION_TYPES

Statuses = Callable[[], Iterable[Mapping[str, Any]]]
"""The statuses of all objects, as last seen or written."""


class Metrics:
    """The operator's metrics, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.reconciles = Counter(
            "robot_offload_reconciles", "Passes over an object by result.", ["result"], registry=self.registry
        )
        self.errors = Counter(
            "robot_offload_errors", "Failures of passes by reason.", ["reason"], registry=self.registry
        )
        self.writes = Counter(
            "robot_offload_writes", "Writes to the API server, without the leader's Lease.", registry=self.registry
        )
        self.seconds = Histogram(
            "robot_offload_reconcile_seconds",
            "How long a pass takes.",
            registry=self.registry,
            buckets=(0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30),
        )

    def show(self, statuses: Statuses, queued: Callable[[], int], leader: Callable[[], bool]) -> None:
        """Adds what is worked out when somebody asks."""
        self.registry.register(_State(statuses, queued, leader))


class _State(Collector):
    def __init__(self, statuses: Statuses, queued: Callable[[], int], leader: Callable[[], bool]) -> None:
        self._statuses = statuses
        self._queued = queued
        self._leader = leader

    def collect(self) -> Iterable[GaugeMetricFamily]:
        """All gauges, from one look at the statuses."""
        statuses = list(self._statuses())
        yield _gauge("robot_offload_objects", "RobotOffloads that this operator keeps.", len(statuses))
        yield _gauge("robot_offload_queue", "Objects that wait for a pass.", self._queued())
        yield _gauge("robot_offload_leader", "1 while this process is the leader.", int(self._leader()))
        connected = sum(bool((status.get("robot") or {}).get("connected")) for status in statuses)
        yield _gauge("robot_offload_robots_connected", "Robots whose agent is connected.", connected)
        sites = Tally(status.get("placement") or "Unknown" for status in statuses)
        placement = GaugeMetricFamily("robot_offload_placement", "Objects by acting side.", labels=["site"])
        for site in ("Robot", "Cloud", "Unknown"):
            placement.add_metric([site], sites[site])
        yield placement
        found = Tally(
            (condition["type"], condition["status"])
            for status in statuses
            for condition in status.get("conditions") or ()
        )
        conditions = GaugeMetricFamily("robot_offload_condition", "Objects by condition.", labels=["type", "status"])
        for name in CONDITION_TYPES:
            for truth in ("True", "False", "Unknown"):
                conditions.add_metric([name, truth], found[name, truth])
        yield conditions


def _gauge(name: str, text: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, text, value=value)
