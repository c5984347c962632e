"""What the collector in front of the consumers adds to a message's way, and how many messages pass it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis.latency import text
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts

GROUP: Final = "collector"
SHARES: Final = {"p50": 0.5, "p99": 0.99}
MIB: Final = 1 << 20


@dataclass(frozen=True)
class Load:
    """What is published.

    Attributes:
        size: of a message's data, bytes.
        rate_hz: messages a second on the collected output, and as many on the direct topic.
        transports: of Fast DDS, in words.
    """

    size: int
    rate_hz: float
    transports: str = "default transports"

    @property
    def title(self) -> str:
        """For people."""
        return f"{text(self.size)}, {self.rate_hz:g} Hz"

    @property
    def name(self) -> str:
        """A word."""
        return f"{self.size}_{self.rate_hz:g}_{self.transports.split()[0].lower()}"


@dataclass(frozen=True)
class Passed:
    """One load with what came of it; latencies in milliseconds.

    Attributes:
        sent: on each of the two topics.
        seconds: how long that took.
    """

    load: Load
    sent: int
    seconds: float
    collected: tuple[float, ...]
    direct: tuple[float, ...]


def outcome(priority: Priority, found: Sequence[Passed]) -> GroupResult:
    """Returns the figures of all loads."""
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=tuple(figure for passed in found for figure in _figures(passed)),
        parts=parts(_parts(found)),
        samples=tuple(_samples(found)),
    )


def _figures(passed: Passed) -> Iterator[Figure]:
    load = passed.load
    for name, share in SHARES.items():
        through, beside = at_or_none(passed.collected, share), at_or_none(passed.direct, share)
        added = None if through is None or beside is None else f"added {through - beside:.2f} ms"
        yield Figure(
            f"{load.name}_{name}", f"{load.title}: through the collector, {name}", load.transports, None,
            len(passed.collected), through, "ms", note=added or "", baseline=beside, against="direct DDS",
        )  # fmt: skip
    direct = 100.0 * len(passed.direct) / passed.sent
    yield Figure(
        f"{load.name}_delivered", f"{load.title}: delivered", load.transports, None, passed.sent,
        100.0 * len(passed.collected) / passed.sent, "%",
        note=f"{len(passed.collected) * load.size / passed.seconds / MIB:.2f} MiB/s",
        baseline=direct, against="direct DDS",
    )  # fmt: skip


def _parts(found: Sequence[Passed]) -> Iterator[Distribution | None]:
    for passed in found:
        title = f"{passed.load.title}, {passed.load.transports}"
        yield part(f"{title}: through the collector", "ms", passed.collected)
        yield part(f"{title}: direct DDS", "ms", passed.direct)


def _samples(found: Sequence[Passed]) -> Iterator[Sample]:
    for passed in found:
        for way, values in (("collector", passed.collected), ("direct", passed.direct)):
            for value in values:
                yield {
                    "payload_bytes": passed.load.size, "rate_hz": passed.load.rate_hz,
                    "transports": passed.load.transports, "way": way,
                    "series": f"{passed.load.title}, {way}{_short(passed.load)}", "ms": round(value, 4),
                }  # fmt: skip


def _short(load: Load) -> str:
    return "" if load.transports.startswith("default") else " (large data)"
