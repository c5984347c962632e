"""Made-up runs for the tests of the report: a wheelchair, a link that is cut now and then, two replicas."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from robot_offload_lab.judge.recording import (
    Arrival,
    Ending,
    Inhibit,
    LinkSample,
    NetworkStatus,
    Obstacle,
    PathPoint,
    PlacementChange,
    Record,
    Recording,
    RunInfo,
    Site,
    assemble,
)

START_S = 1000.0
PERIOD_S = {"robot": 0.05, "cloud": 0.02}
PRODUCERS = {"robot": "controller", "cloud": "remote_controller"}
TOPIC = "/cmd_vel"
RUN = RunInfo(
    mode="offload",
    seed=7,
    start_s=START_S,
    max_command_age_ms=150.0,
    loss_timeout_ms=90.0,
    activation_deadline_ms=250.0,
    robot_period_ms=50.0,
    cloud_period_ms=20.0,
    threshold_ms=60.0,
    corridor_length_m=40.0,
    corridor_width_m=2.4,
)


def stay(site: Site, start_s: float, end_s: float, *, topic: str = TOPIC, latency_s: float = 0.004) -> list[Arrival]:
    """The messages of one side from `start_s` to `end_s` of the run; a replica counts all the time, also unheard."""
    period_s = PERIOD_S[site]
    first, last = math.ceil(start_s / period_s - 1e-9), math.ceil(end_s / period_s - 1e-9)
    return [
        Arrival(
            topic,
            START_S + n * period_s + latency_s,
            PRODUCERS[site],
            n + 1,
            START_S + n * period_s,
            site,
        )
        for n in range(first, last)
    ]


def placement(
    t_s: float, site: Site, epoch: int, reason: str = "LinkGood", detect_ms: float | None = None
) -> PlacementChange:
    return PlacementChange(START_S + t_s, site, epoch, reason, f"{reason} at {t_s:g} s", detect_ms)


def link(duration_s: float, outages: Sequence[tuple[float, float]] = (), rtt_ms: float = 20.0) -> list[LinkSample]:
    """A sample each 100 ms; None within the outages."""
    times = [n / 10 for n in range(round(duration_s * 10))]
    return [LinkSample(START_S + t, None if any(start <= t < end for start, end in outages) else rtt_ms) for t in times]


def calm_run() -> list[Record]:
    """20 s: the robot starts, the cloud takes over at 2 s, is lost at 10 s, comes back at 15 s. Nothing is wrong."""
    outages = [(9.92, 14.0)]
    arrivals = [
        *stay("robot", 0.0, 2.0),
        *stay("cloud", 2.0, 9.92),
        *stay("robot", 10.05, 15.0),
        *stay("cloud", 15.0, 20.0),
    ]
    path = [PathPoint(START_S + t / 10, 1.0 + t * 0.08, 0.3 * math.sin(t / 12), 0.8) for t in range(200)]
    return [
        RUN,
        *arrivals,
        placement(0.0, "robot", 1, "Start"),
        placement(2.0, "cloud", 2),
        placement(10.02, "robot", 3, "HeartbeatLost", detect_ms=92.0),
        placement(15.0, "cloud", 4),
        *link(20.0, outages),
        NetworkStatus(START_S, "robot", True),
        NetworkStatus(START_S + 10.02, "robot", False),
        NetworkStatus(START_S + 14.5, "robot", True),
        *path,
        Obstacle(6.0, 0.5, 0.25),
        Obstacle(11.0, -0.6, 0.2),
        Ending(START_S + 20.0, collisions=0, stops=0, goal_reached=True),
    ]


def recording(records: Sequence[Record]) -> Recording:
    return assemble(records)


def changed(records: Sequence[Record], edit: Callable[[Record], Record | list[Record] | None]) -> Recording:
    """`records` with each one replaced by what `edit` makes of it: another one, several, or none."""
    result: list[Record] = []
    for record in records:
        edited = edit(record)
        result += edited if isinstance(edited, list) else [edited] if edited is not None else []
    return assemble(result)


def is_arrival(record: Record, site: Site, after_s: float, before_s: float) -> bool:
    """Whether `record` is a message of a side published within a span of the run."""
    if not isinstance(record, Arrival) or record.site != site:
        return False
    return START_S + after_s <= record.sent_t_s < START_S + before_s


def inhibited(start_s: float, end_s: float) -> list[Record]:
    return [Inhibit(START_S + start_s, True), Inhibit(START_S + end_s, False)]


def later(arrival: Arrival, by_s: float) -> Arrival:
    return dataclasses.replace(arrival, t_s=arrival.t_s + by_s)
