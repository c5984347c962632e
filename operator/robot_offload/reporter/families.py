"""Every metric of the reporter, declared once: the source of the page and of the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric

from robot_offload.api.agent_state import MAX_NODES, MAX_TOPICS
from robot_offload.api.side_numbers import GAP_S, LATENCY_S, Histogram


@dataclass(frozen=True, slots=True)
class Family:
    """One metric.

    Attributes:
        name: as in Prometheus, a counter without its `_total`.
        kind: gauge, counter or histogram.
        text: the meaning of one value; the unit is in the name.
        labels: their names.
        series: maximum of its series for one agent.
    """

    name: str
    kind: str
    text: str
    labels: tuple[str, ...] = ()
    series: int = 1

    def one(self, value: float) -> Metric:
        """Return the metric with one value and no label."""
        found = self.empty()
        found.add_metric([], float(value))
        return found

    def empty(self) -> GaugeMetricFamily | CounterMetricFamily:
        """Return the metric without values."""
        if self.kind == "counter":
            return CounterMetricFamily(self.name, self.text, labels=self.labels)
        return GaugeMetricFamily(self.name, self.text, labels=self.labels)

    def histograms(self) -> HistogramMetricFamily:
        """Return the metric, a histogram, without values."""
        return HistogramMetricFamily(self.name, self.text, labels=self.labels)


def add(family: HistogramMetricFamily, labels: list[str], bounds: tuple[float, ...], histogram: Histogram) -> None:
    """Add one histogram, with cumulative counts as Prometheus requires."""
    total, buckets = 0, []
    for bound, count in zip((*map(str, bounds), "+Inf"), histogram.counts, strict=True):
        total += count
        buckets.append((bound, float(total)))
    family.add_metric(labels, buckets, histogram.sum_s)


_SIDES: Final = 2
_REASONS: Final = 32
_PROCESSES: Final = 5
_ROBOT: Final = "robot_offload_"

ALIVE: Final = Family(f"{_ROBOT}agent_alive", "gauge", "1 while the cloud's agent writes its state.")
STATE_AGE: Final = Family(f"{_ROBOT}agent_state_age_seconds", "gauge", "Age of the state of the cloud's agent.")
CONNECTED: Final = Family(f"{_ROBOT}robot_connected", "gauge", "1 while the robot is connected.")
AGENT_READY: Final = Family(f"{_ROBOT}agent_ready", "gauge", "1 while the cloud's agent listens for its robot.")
EPOCH: Final = Family(f"{_ROBOT}epoch", "gauge", "Number of the present changeover.")
PLACEMENT: Final = Family(
    f"{_ROBOT}placement", "gauge", "1 for the side that acts: robot, cloud or unknown.", ("site",), 3
)
ROUND_TRIP: Final = Family(
    f"{_ROBOT}round_trip_seconds",
    "gauge",
    "Round trip of the last 250 beats as the cloud sees it, by quantile (0.5, 0.99).",
    ("quantile",),
    2,
)
LATENCY_NOW: Final = Family(
    f"{_ROBOT}link_latency_now_seconds",
    "gauge",
    "Loop latency that counts now: the newest round trip, or more when echoes are overdue.",
    ("side",),
    _SIDES,
)
LOSS: Final = Family(
    f"{_ROBOT}link_loss_ratio",
    "gauge",
    "Share of the beats of the last 2 s that this side missed, 0 to 1.",
    ("side",),
    _SIDES,
)
LATENCY: Final = Family(
    f"{_ROBOT}link_latency_seconds",
    "histogram",
    "Round trips of the beats since the agent's start.",
    ("side",),
    _SIDES * (len(LATENCY_S) + 3),
)
BEATS_RECEIVED: Final = Family(
    f"{_ROBOT}beats_received", "counter", "Beats of the other side that arrived.", ("side",), _SIDES
)
BEATS_LOST: Final = Family(
    f"{_ROBOT}beats_lost",
    "counter",
    "Beats of the other side that did not arrive before a newer one.",
    ("side",),
    _SIDES,
)
CLOCK_OFFSET: Final = Family(
    f"{_ROBOT}clock_offset_seconds", "gauge", "System clock of the cloud minus that of the robot.", ("side",)
)
CHANGEOVERS: Final = Family(
    f"{_ROBOT}changeovers",
    "counter",
    "Changes of the side in charge, by the side that took over (`to`) and the reason.",
    ("side", "to", "reason"),
    2 * _REASONS,
)
LOSSES: Final = Family(
    f"{_ROBOT}loss_detections", "counter", "Takeovers of the robot because the cloud was silent.", ("side",)
)
FALSE_ALARMS: Final = Family(
    f"{_ROBOT}false_alarms",
    "counter",
    "Of these, those after which a beat came within another `lossTimeout`: the link was late and not gone.",
    ("side",),
)
SILENCE: Final = Family(
    f"{_ROBOT}nobody_in_charge_seconds",
    "counter",
    "Time without a good beat of the cloud before the robot took over: the longest time without an active side.",
    ("side",),
)
GAP: Final = Family(
    f"{_ROBOT}command_gap_seconds",
    "histogram",
    "Time between two messages of a rated output on their way to the driver.",
    ("side", "output"),
    4 * (len(GAP_S) + 3),
)
OVERDUE: Final = Family(
    f"{_ROBOT}command_overdue_seconds",
    "counter",
    "How long messages of a rated output were overdue beyond its deadline.",
    ("side", "output"),
    4,
)
TOPIC_BYTES: Final = Family(
    f"{_ROBOT}topic_bytes",
    "counter",
    "Bytes that crossed the link, as the cloud got or sent them.",
    ("side", "topic", "direction"),
    MAX_TOPICS,
)
TOPIC_MESSAGES: Final = Family(
    f"{_ROBOT}topic_messages",
    "counter",
    "Messages that crossed the link, as the cloud got or sent them.",
    ("side", "topic", "direction"),
    MAX_TOPICS,
)
INPUT_MESSAGES: Final = Family(
    f"{_ROBOT}input_messages",
    "counter",
    "Messages of an input on the robot by their fate: sent, rate_limited, thinned, unsent (refused by the link).",
    ("side", "topic", "fate"),
    4 * 32,
)
REFUSED: Final = Family(
    f"{_ROBOT}refused_messages",
    "counter",
    "Messages of the cloud that the robot's collector refused, by reason.",
    ("side", "reason"),
    _REASONS,
)
GOALS: Final = Family(
    f"{_ROBOT}goals",
    "counter",
    "Goals of actions that ended, by outcome: succeeded, aborted, canceled.",
    ("side", "action", "outcome"),
    3 * 32,
)
OPEN_GOALS: Final = Family(
    f"{_ROBOT}open_goals",
    "gauge",
    "Goals of clients now: executing on the side that acts, or waiting for a side that can.",
    ("side", "action", "state"),
    2 * 32,
)
GOAL_RESTARTS: Final = Family(
    f"{_ROBOT}goal_restarts",
    "counter",
    "How often a goal's execution began anew: on the other side, or after its server forgot it.",
    ("side", "action"),
    32,
)
OPEN_CALLS: Final = Family(
    f"{_ROBOT}open_calls", "gauge", "Calls of clients that are not answered yet.", ("side", "service"), 32
)
OPEN_USED: Final = Family(
    f"{_ROBOT}open_used",
    "gauge",
    "Goals and calls (`kind`) of duplicated nodes at servers outside, that have not ended yet.",
    ("side", "kind"),
    2,
)
STATE_AT_CHANGE: Final = Family(
    f"{_ROBOT}state_age_at_change_seconds",
    "gauge",
    "How old the state was with which this side's nodes went on when it last began to act.",
    ("side", "state"),
    MAX_TOPICS + 32,
)
NODE_STATE: Final = Family(
    f"{_ROBOT}node_state",
    "gauge",
    "1 for the present lifecycle state of each node in the cloud.",
    ("node", "state"),
    MAX_NODES,
)
SIDE_READY: Final = Family(
    f"{_ROBOT}side_ready",
    "gauge",
    "1 while this side's CORE nodes could act at once: Active, or Hot standby.",
    ("side",),
    _SIDES,
)
CPU: Final = Family(
    f"{_ROBOT}process_cpu_seconds",
    "counter",
    "Processor time of each process of the agent.",
    ("side", "process"),
    _SIDES * _PROCESSES,
)
MEMORY: Final = Family(
    f"{_ROBOT}process_resident_memory_bytes",
    "gauge",
    "Resident memory of each process of the agent; they share the memory of their code.",
    ("side", "process"),
    _SIDES * _PROCESSES,
)
DEATHS: Final = Family(
    f"{_ROBOT}process_deaths",
    "counter",
    "How often each process of the agent ended and was started again.",
    ("side", "process"),
    _SIDES * _PROCESSES,
)
ROBOT_REPORT: Final = Family(
    f"{_ROBOT}robot_report",
    "gauge",
    '1 while the robot\'s own numbers are younger than 5 s; without them side="robot" is missing.',
)
GARBAGE: Final = Family(
    f"{_ROBOT}garbage_reports",
    "counter",
    "Reports in the name of the robot that were none, or of another version.",
    ("side",),
)
LEFT_OUT: Final = Family(
    f"{_ROBOT}report_entries_left_out", "gauge", "Entries for which the robot's report had no room.", ("side",)
)
AGENT_GENERATION: Final = Family(
    f"{_ROBOT}agent_generation", "gauge", "Generation of the RobotOffload that the cloud's agent was started with."
)
ROBOT_GENERATION: Final = Family(f"{_ROBOT}robot_generation", "gauge", "Generation that the robot runs.")
ACCEPTED: Final = Family(f"{_ROBOT}settings_accepted", "gauge", "1 when the robot took the last settings.")
LEASE_WRITES: Final = Family(f"{_ROBOT}lease_writes", "counter", "Writes of the robot's Lease that succeeded.")
LEASE_FAILURES: Final = Family(f"{_ROBOT}lease_failures", "counter", "Writes of the robot's Lease that failed.")
HANDOVERS: Final = Family(f"{_ROBOT}handovers", "counter", "Handovers that pods have asked for before they stop.")
STREAMS_REFUSED: Final = Family(f"{_ROBOT}streams_refused", "counter", "Clients of the stream that found it full.")
STREAMS_DROPPED: Final = Family(f"{_ROBOT}streams_dropped", "counter", "Clients of the stream that were too slow.")

FAMILIES: Final = tuple(value for value in tuple(globals().values()) if isinstance(value, Family))
"""All of them, in the order of the page."""
