"""The field's standard experiment: latencies of ten publishers in several scenarios, processor time beside them.

On one host a latency is one way, from the stamp to the subscriber's middleware. Where two domains or hosts are joined
it is half a round trip: the far end sends every message back as it came.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis.travel import travel_ms
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import Arrival

GROUP: Final = "experiment"
SHARES: Final = {"p50": 0.5, "p99": 0.99}
LIMITS: Final = {"p50": (4.0, 2.5), "p99": (12.0, 6.0)}
"""Name -> (must, aim), milliseconds that the default transport may add over the link's own delay."""


@dataclass(frozen=True)
class ExperimentScenario:
    """Where the ten topics travel.

    Attributes:
        name: a word.
        title: for people.
        conditions: of the link.
        halved: latencies are half a round trip.
        against: name of the scenario in the same run that this one is compared with; empty for none.
        demanded: whether the limits are for this one.
        thesis: what the thesis measured in the nearest situation; empty when it had none.
    """

    name: str
    title: str
    conditions: str
    halved: bool
    against: str = ""
    demanded: bool = False
    thesis: str = ""


@dataclass(frozen=True)
class Travelled:
    """What was measured in a scenario.

    Attributes:
        latencies_ms: by kind of message.
        lost: sequence numbers that are missing.
        own_ms: the emulated link's own one-way delay, median; None without a link.
        machine_percent: how busy the machine was, 100 is every core.
        own_percent: of one core, by all programs of the scenario but the emulated link.
        agent_percent: of one core, by the robot's agent; None without one.
    """

    scenario: ExperimentScenario
    latencies_ms: Mapping[str, tuple[float, ...]]
    lost: int
    own_ms: float | None
    machine_percent: float
    own_percent: float
    agent_percent: float | None = None

    @property
    def all_ms(self) -> tuple[float, ...]:
        """The latencies of all kinds."""
        return tuple(value for values in self.latencies_ms.values() for value in values)


def latencies(
    arrivals: Iterable[Arrival], window: Interval, within: Sequence[Interval], *, halved: bool
) -> list[float]:
    """Return the latencies of the window's messages that arrived with the far end in charge, milliseconds."""
    return [
        travel_ms(arrival) / (2 if halved else 1)
        for arrival in arrivals
        if window.start_s <= arrival.sent_t_s <= window.end_s
        and any(stay.start_s <= arrival.t_s <= stay.end_s for stay in within)
    ]


def lost(arrivals: Iterable[Arrival], window: Interval) -> int:
    """Return how many numbers are missing between the first and the last message of the window."""
    numbers = {a.sequence for a in arrivals if window.start_s <= a.sent_t_s <= window.end_s}
    return max(numbers) - min(numbers) + 1 - len(numbers) if numbers else 0


def outcome(priority: Priority, found: Sequence[Travelled], refused: Mapping[str, str]) -> GroupResult:
    """Return the figures of all scenarios.

    Args:
        priority: of nodes and agents.
        found: what was measured.
        refused: title of a scenario -> why it did not run here.
    """
    by_name = {travelled.scenario.name: travelled for travelled in found}
    figures = [figure for one in found for figure in _figures(one, by_name.get(one.scenario.against))]
    figures += [
        Figure(f"missing_{title}", "Latency", title, None, 0, None, "ms", note=f"not run: {why}")
        for title, why in refused.items()
    ]
    return GroupResult(GROUP, priority, tuple(figures), parts(_parts(found)), tuple(_samples(found)))


def _figures(one: Travelled, beside: Travelled | None) -> Iterator[Figure]:
    scenario, all_ms = one.scenario, one.all_ms
    way = "half a round trip" if scenario.halved else "one way"
    for name, share in SHARES.items():
        base = None if beside is None else at_or_none(beside.all_ms, share)
        yield Figure(
            f"{scenario.name}_{name}", f"{scenario.title}, {way}, {name}", scenario.conditions, None, len(all_ms),
            at_or_none(all_ms, share), "ms", note=f"thesis: {scenario.thesis}" if scenario.thesis else "",
            baseline=base, against=beside.scenario.title if beside is not None else "",
        )  # fmt: skip
    if one.own_ms is not None:
        yield from _added(one, beside)
    yield Figure(
        f"{scenario.name}_lost", f"{scenario.title}: messages lost", scenario.conditions, None, len(all_ms), one.lost,
        "messages",
    )  # fmt: skip
    agent = "" if one.agent_percent is None else f"; of it the robot's agent {one.agent_percent:.1f}"
    yield Figure(
        f"{scenario.name}_cpu", f"{scenario.title}: processor time of all its programs", scenario.conditions, None,
        1, one.own_percent, "% of a core", note=f"whole machine {one.machine_percent:.0f} % of all cores{agent}",
    )  # fmt: skip


def _added(one: Travelled, beside: Travelled | None) -> Iterator[Figure]:
    scenario, own_ms = one.scenario, one.own_ms
    assert own_ms is not None
    for name, share in SHARES.items():
        value = at_or_none(one.all_ms, share)
        must, aim = LIMITS[name] if scenario.demanded else (None, None)
        other_ms = at_or_none(beside.all_ms, share) if beside is not None else None
        words = ""
        if beside is not None and beside.own_ms is not None and other_ms is not None:
            words = f"direct DDS adds {other_ms - beside.own_ms:.2f} ms"
        yield Figure(
            f"{scenario.name}_added_{name}", f"{scenario.title}: added over the link's own delay, {name}",
            scenario.conditions, None, len(one.all_ms), None if value is None else value - own_ms, "ms", must, aim,
            note=words,
        )  # fmt: skip


def _parts(found: Sequence[Travelled]) -> Iterator[Distribution | None]:
    for one in found:
        yield part(one.scenario.title, "ms", one.all_ms)
    for one in found:
        if one.scenario.demanded:
            for kind, values in one.latencies_ms.items():
                yield part(f"{one.scenario.title}: {kind}", "ms", values)


def _samples(found: Sequence[Travelled]) -> Iterator[Sample]:
    for one in found:
        for kind, values in one.latencies_ms.items():
            for value in values:
                yield {
                    "scenario": one.scenario.name, "series": one.scenario.title, "kind": kind, "ms": round(value, 4)
                }  # fmt: skip
