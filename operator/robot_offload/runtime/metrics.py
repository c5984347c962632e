"""The operator's Prometheus metrics: its own work, and the state of all objects in sums."""

from __future__ import annotations

import datetime
from collections import Counter as Tally
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.metadata import version
from typing import Any

from prometheus_client import (
    CollectorRegistry,
    Counter,
    GCCollector,
    Histogram,
    Info,
    PlatformCollector,
    ProcessCollector,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from robot_offload.api.v1alpha1.status import CONDITION_TYPES, PROGRESS_TYPES

Statuses = Callable[[], Iterable[tuple[tuple[str, str], Mapping[str, Any]]]]
"""The statuses of all objects, as last seen or written, by namespace and name."""


class Metrics:
    """The operator's metrics, in a separate registry."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        for collector in (ProcessCollector, PlatformCollector, GCCollector):
            collector(registry=self.registry)
        build = Info("robot_offload_build", "The version of this operator.", registry=self.registry)
        build.info({"version": version("robot-offload")})
        self.reconciles = Counter(
            "robot_offload_reconciles", "Passes over an object by result.", ["result"], registry=self.registry
        )
        self.errors = Counter(
            "robot_offload_errors", "Failures of passes by reason.", ["reason"], registry=self.registry
        )
        self.seconds = Histogram(
            "robot_offload_reconcile_seconds",
            "How long a pass takes.",
            registry=self.registry,
            buckets=(0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30),
        )

        self.waited = Histogram(
            "robot_offload_queue_wait_seconds",
            "How long an object waits for its pass once that is due.",
            registry=self.registry,
            buckets=(0.01, 0.05, 0.1, 0.5, 1, 2, 5, 10, 30, 60, 300),
        )

    def show(
        self,
        statuses: Statuses,
        calls: Callable[[], Mapping[str, int]],
        queued: Callable[[], int],
        late_s: Callable[[], float],
        leader: Callable[[], bool],
    ) -> None:
        """Add the metrics that are computed at each scrape."""
        self.registry.register(_State(statuses, calls, queued, late_s, leader))


class _State(Collector):
    def __init__(
        self,
        statuses: Statuses,
        calls: Callable[[], Mapping[str, int]],
        queued: Callable[[], int],
        late_s: Callable[[], float],
        leader: Callable[[], bool],
    ) -> None:
        self._statuses = statuses
        self._calls = calls
        self._queued = queued
        self._late_s = late_s
        self._leader = leader

    def collect(self) -> Iterable[Metric]:
        """Yield all of them, from one read of the statuses."""
        requests = CounterMetricFamily(
            "robot_offload_requests",
            "Requests to the API server by verb, without watches and the leader's Lease.",
            labels=["verb"],
        )
        for verb, count in sorted(self._calls().items()):
            requests.add_metric([verb], count)
        yield requests
        named = list(self._statuses())
        statuses = [status for _, status in named]
        yield _info(named)
        yield _certificates(named)
        yield _gauge("robot_offload_objects", "RobotOffloads that this operator keeps.", len(statuses))
        yield _gauge("robot_offload_queue", "Objects that wait for a pass.", self._queued())
        yield _gauge("robot_offload_queue_late_seconds", "For how long the oldest of them waits.", self._late_s())
        yield _gauge("robot_offload_leader", "1 while this process is the leader.", int(self._leader()))
        connected = sum(bool((status.get("robot") or {}).get("connected")) for status in statuses)
        yield _gauge("robot_offload_robots_connected", "Robots whose agent is connected.", connected)
        sites = Tally(status.get("placement") or "Unknown" for status in statuses)
        placement = GaugeMetricFamily("robot_offload_robots", "Robots by acting side.", labels=["site"])
        for site in ("Robot", "Cloud", "Unknown"):
            placement.add_metric([site], sites[site])
        yield placement
        found = Tally(
            (condition["type"], condition["status"])
            for status in statuses
            for condition in status.get("conditions") or ()
        )
        conditions = GaugeMetricFamily("robot_offload_condition", "Objects by condition.", labels=["type", "status"])
        for name in (*CONDITION_TYPES, *PROGRESS_TYPES):
            for truth in ("True", "False", "Unknown"):
                conditions.add_metric([name, truth], found[name, truth])
        yield conditions
        yield _builds(statuses)


def _info(named: Iterable[tuple[tuple[str, str], Mapping[str, Any]]]) -> Metric:
    """Return one series for each object, for joins and for alerts by name."""
    found = InfoMetricFamily(
        "robot_offload", "What is known of each object.", labels=["namespace", "name", "site", "connected", "ready"]
    )
    for (namespace, name), status in named:
        truths = {condition["type"]: condition["status"] for condition in status.get("conditions") or ()}
        connected = str(bool((status.get("robot") or {}).get("connected"))).lower()
        site, ready = status.get("placement") or "Unknown", truths.get("Ready", "Unknown")
        found.add_metric([namespace, name, site, connected, ready], {})
    return found


def _builds(statuses: Iterable[Mapping[str, Any]]) -> Metric:
    """Return the results of the image builds; the reasons are words of this operator."""
    found = GaugeMetricFamily(
        "robot_offload_builds",
        "Objects whose images are built in the cluster, by reason of ImageBuilt.",
        labels=["reason"],
    )
    reasons = Tally(status.get("build", "NotNeeded") for status in statuses)
    reasons.pop("NotNeeded", None)
    for reason, count in sorted(reasons.items()):
        found.add_metric([reason], count)
    return found


def _certificates(named: Iterable[tuple[tuple[str, str], Mapping[str, Any]]]) -> Metric:
    """Yield when the certificates of each object end, as in its status."""
    found = GaugeMetricFamily(
        "robot_offload_certificate_expiration_timestamp_seconds",
        "When a certificate ends: the cloud's, that of a bundle written now, and the one that the robot dials with.",
        labels=["namespace", "name", "holder"],
    )
    for (namespace, name), status in named:
        for holder, end in (status.get("certificates") or {}).items():
            with suppress(ValueError):
                moment = datetime.datetime.fromisoformat(str(end)).timestamp()
                found.add_metric([namespace, name, str(holder)], moment)
    return found


def _gauge(name: str, text: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, text, value=value)
