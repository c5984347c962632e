"""Little runs written by hand for the bench's analysis: times in seconds, messages one by one."""

from __future__ import annotations

from collections.abc import Iterable

from robot_offload_core.fence.token import Site as Side
from robot_offload_core.words import beats
from robot_offload_core.words.beats import Beat, CloudReport, Echo, Permission
from robot_offload_lab.bench.observed import Answered, BeatHeard, Transition
from robot_offload_lab.bench.resource import COMMAND
from robot_offload_lab.judge.recording import Arrival, Ending, PlacementChange, Recording, RunInfo, Site, assemble

ROBOT, CLOUD, OTHER = "a" * 32, "b" * 32, "c" * 32
START_S = 100.0


def arrivals(site: Site, first: int, times_s: Iterable[float], age_s: float = 0.001) -> list[Arrival]:
    producer = "remote_replica" if site == "cloud" else "replica"
    return [
        Arrival(COMMAND, t_s, producer, number, t_s - age_s, site) for number, t_s in enumerate(times_s, start=first)
    ]


def recording(*found: Iterable[Arrival], end_s: float = 200.0) -> Recording:
    run = RunInfo("offload", 1, START_S, 150.0, 90.0, 250.0, 50.0, 20.0, 60.0)
    return assemble([run, *(arrival for some in found for arrival in some), Ending(end_s)])


def every(from_s: float, to_s: float, period_s: float) -> list[float]:
    count = round((to_s - from_s) / period_s)
    return [from_s + number * period_s for number in range(count)]


def placed(since_s: float, site: Site, silent_ms: float | None = None, reason: str = "ByHand") -> PlacementChange:
    return PlacementChange(
        since_s + 0.001, site, 1, reason, detect_ms=silent_ms, phase=site.capitalize(), since_s=since_s
    )


def answered(asked_s: float, site: str) -> Answered:
    return Answered(asked_s + 0.002, asked_s, site, True, "")


def active(t_s: float) -> Transition:
    return Transition(t_s, "active")


def cloud_beat(t_s: float, echo_age_s: float, serves: str = ROBOT, sequence: int = 1) -> BeatHeard:
    echo = Echo(ROBOT, 1, round((t_s - echo_age_s) * 1e6), 0)
    beat = Beat("bench", Side.CLOUD, CLOUD, sequence, round(t_s * 1e6), 0, 0, echo, CloudReport(serves=serves))
    return BeatHeard(t_s, beats.encode(beat))


def grant(sent_s: float, epoch: int = 1, granted: bool = True) -> str:
    body = Permission(epoch, granted, CLOUD, 250_000)
    return beats.encode(Beat("bench", Side.ROBOT, ROBOT, 1, round(sent_s * 1e6), 0, 0, None, body))
