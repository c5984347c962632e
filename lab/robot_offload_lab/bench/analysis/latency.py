"""What the product adds to a message's way, beside direct DDS on one machine in the same run.

A sample is the time from the stamp (just before a node publishes) until the consumer's middleware has it, less the
median of what the emulated link itself took for as many datagrams as a message of that size needs: so the link's jitter
counts as ours. Commands come from the cloud, through link and collector; inputs go to the cloud, through the link.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis.travel import travel_ms
from robot_offload_lab.bench.observed import Hop, size_of
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts
from robot_offload_lab.judge.recording import Arrival

GROUP: Final = "latency"
LIMITS: Final = {"p50": (0.5, 4.0, 2.5), "p99": (0.99, 12.0, 6.0)}
"""Name -> (share, must, aim); milliseconds."""


@dataclass(frozen=True)
class Journeys:
    """One way of messages: title for people, one-way latencies by payload size."""

    name: str
    title: str
    latencies_ms: dict[int, tuple[float, ...]]


@dataclass(frozen=True)
class LatencyAccount:
    """Arrivals of commands (from the cloud), of inputs (in the cloud) and of the direct topic, and the link's hops."""

    commands: tuple[Arrival, ...]
    inputs: tuple[Arrival, ...]
    direct: tuple[Arrival, ...]
    hops: tuple[Hop, ...]


def by_size(arrivals: Iterable[Arrival], sizes: Sequence[int]) -> dict[int, tuple[float, ...]]:
    """One-way latencies in milliseconds by payload size."""
    found: dict[int, list[float]] = {size: [] for size in sizes}
    for arrival in arrivals:
        found[size_of(arrival.sequence, sizes)].append(travel_ms(arrival))
    return {size: tuple(values) for size, values in found.items()}


def outcome(case: BenchCase, priority: Priority, account: LatencyAccount) -> GroupResult:
    """Returns the figures of one run."""
    sizes = case.command_bytes
    commands = [arrival for arrival in account.commands if arrival.site == "cloud"]
    ways = (
        Journeys("command", "cloud to robot, link and collector", by_size(commands, sizes)),
        Journeys("input", "robot to cloud, link alone", by_size(account.inputs, sizes)),
    )
    direct = by_size(account.direct, sizes)
    wire = {size: at_or_none((hop.delay_ms for hop in account.hops if hop.size == size), 0.5) for size in sizes}
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=tuple(_figures(case, ways, direct, wire)),
        parts=parts(_parts(ways, direct, account.hops, sizes)),
        samples=tuple(_samples(ways, direct, account.hops)),
    )


def _figures(
    case: BenchCase, ways: Sequence[Journeys], direct: dict[int, tuple[float, ...]], wire: dict[int, float | None]
) -> Iterator[Figure]:
    for way in ways:
        for size, latencies in way.latencies_ms.items():
            own_ms = wire[size]
            added = [] if own_ms is None else [latency - own_ms for latency in latencies]
            for name, (share, must, aim) in LIMITS.items():
                beside = at_or_none(direct[size], share)
                yield Figure(
                    f"{way.name}_{size}_{name}", f"Added over the link's own delay, {way.title}, {text(size)}, {name}",
                    case.describe(), case.tolerance_ms, len(added), at_or_none(added, share), "ms", must, aim,
                    note="" if beside is None else f"direct DDS beside it: {beside:.2f} ms",
                )  # fmt: skip


def text(size: int) -> str:
    """Returns a payload for people."""
    return f"{size // 1024} KiB" if size >= 1024 and size % 1024 == 0 else f"{size} B"


def _parts(
    ways: Sequence[Journeys], direct: dict[int, tuple[float, ...]], hops: Sequence[Hop], sizes: Sequence[int]
) -> Iterator[Distribution | None]:
    for size in sizes:
        for way in ways:
            yield part(f"{text(size)}: {way.title}, whole way", "ms", way.latencies_ms[size])
        yield part(f"{text(size)}: the emulated link itself", "ms", (h.delay_ms for h in hops if h.size == size))
        yield part(f"{text(size)}: direct DDS", "ms", direct[size])


def _samples(ways: Sequence[Journeys], direct: dict[int, tuple[float, ...]], hops: Sequence[Hop]) -> Iterator[Sample]:
    for name, latencies in (*((way.name, way.latencies_ms) for way in ways), ("direct", direct)):
        for size, values in latencies.items():
            for value in values:
                yield {"way": name, "payload_bytes": size, "latency_ms": round(value, 4)}
    for hop in hops:
        yield {"way": "link", "payload_bytes": hop.size, "latency_ms": round(hop.delay_ms, 4)}
