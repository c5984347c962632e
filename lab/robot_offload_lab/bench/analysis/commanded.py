"""Commanded switches: what the consumer felt of them.

For each switch that was asked for by hand:

* answer: from asking to the agent's answer;
* activation: from asking until the new side's node reports Active;
* timer phase: from there to the first message of the new side at the consumer (to the cloud: with the way through the
  link). Until then the old side's messages pass;
* gap: the longest silence at the consumer that touches the time from asking to that first message.

Duplicates, reordered, stale and lost messages are counted over the whole run, not only around the switches
(definitions: `local.streams`).
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from robot_offload_lab.bench.observed import Answered, Observation, Transition, only
from robot_offload_lab.bench.resource import COMMAND, BenchCase
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, at_or_none, part, parts
from robot_offload_lab.judge.recording import Arrival, Recording
from robot_offload_lab.judge.streams import Stream, examine

GROUP: Final = "commanded"
MUST_EXTRA_MS: Final = 10.0
AIM_EXTRA_MS: Final = 3.0
AIM_SWITCHES: Final = 1000


@dataclass(frozen=True)
class CommandedSwitch:
    """One switch; times in milliseconds, None where the moment was not seen."""

    number: int
    to: str
    answer_ms: float
    activation_ms: float | None
    phase_ms: float | None
    gap_ms: float | None


def switches(
    recording: Recording, robot: Sequence[Observation], cloud: Sequence[Observation]
) -> tuple[CommandedSwitch, ...]:
    """Return every switch of a run."""
    arrivals = recording.outputs.get(COMMAND, ())
    transitions = {"robot": only(Transition, robot), "cloud": only(Transition, cloud)}
    asked = [answer for answer in only(Answered, robot) if answer.accepted]
    return tuple(_switches(asked, arrivals, transitions))


def _switches(
    asked: Sequence[Answered], arrivals: Sequence[Arrival], transitions: Mapping[str, Sequence[Transition]]
) -> Iterator[CommandedSwitch]:
    times = [arrival.t_s for arrival in arrivals]
    active = {site: [e.t_s for e in events if e.state == "active"] for site, events in transitions.items()}
    for number, answer in enumerate(asked, start=1):
        begin = bisect.bisect(times, answer.asked_s)
        first = next((i for i in range(begin, len(times)) if arrivals[i].site == answer.site), None)
        if first is None:
            continue
        event = bisect.bisect(active[answer.site], answer.asked_s)
        active_s = active[answer.site][event] if event < len(active[answer.site]) else float("inf")
        # The event may be heard a moment after the message: they travel by different topics.
        known = active_s < times[first]
        around = times[max(0, begin - 1) : first + 1]
        yield CommandedSwitch(
            number=number,
            to=answer.site,
            answer_ms=(answer.t_s - answer.asked_s) * 1e3,
            activation_ms=(active_s - answer.asked_s) * 1e3 if known else None,
            phase_ms=(times[first] - active_s) * 1e3 if known else None,
            gap_ms=max(((b - a) * 1e3 for a, b in itertools.pairwise(around)), default=None),
        )


def stream(recording: Recording) -> Stream:
    """Return the consumer's view of the command."""
    arrivals = recording.outputs.get(COMMAND, ())
    return examine(COMMAND, arrivals, recording.end_s, recording.run.max_command_age_ms)


def outcome(
    case: BenchCase,
    priority: Priority,
    recording: Recording,
    robot: Sequence[Observation],
    cloud: Sequence[Observation],
) -> GroupResult:
    """Return the figures of a run of commanded switches."""
    found = switches(recording, robot, cloud)
    seen = stream(recording)
    faults = {
        "duplicates": len(seen.duplicates), "reordered": len(seen.reordered), "stale": len(seen.stale),
        "lost": seen.lost,
    }  # fmt: skip
    slower_ms = max(recording.run.robot_period_ms, recording.run.cloud_period_ms)
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(
            Figure(
                "faults", "Duplicates, reordered, stale and lost commands at commanded switches", case.describe(),
                case.tolerance_ms, len(found), sum(faults.values()), "messages", 0, 0,
                note=_faults_note(faults, len(seen.arrivals), len(found)),
            ),
            Figure(
                "gap_p99", "Command gap at a commanded switch, p99", case.describe(), case.tolerance_ms, len(found),
                at_or_none((s.gap_ms for s in found), 0.99), "ms", slower_ms + MUST_EXTRA_MS, slower_ms + AIM_EXTRA_MS,
                note=f"the slower replica's period is {slower_ms:g} ms",
            ),
        ),
        parts=parts(_parts(found)),
        samples=tuple(asdict(switch) for switch in found),
    )  # fmt: skip


def _faults_note(faults: Mapping[str, int], messages: int, count: int) -> str:
    words = ", ".join(f"{number} {name}" for name, number in faults.items())
    few = f"; the aim is for {AIM_SWITCHES} switches" if count < AIM_SWITCHES else ""
    return f"{words} of {messages} messages{few}"


def _parts(found: Sequence[CommandedSwitch]) -> Iterator[Distribution | None]:
    for to in ("robot", "cloud"):
        there = [switch for switch in found if switch.to == to]
        yield part(f"to the {to}: asked until answered", "ms", (s.answer_ms for s in there))
        yield part(f"to the {to}: asked until Active (the old side goes on)", "ms", (s.activation_ms for s in there))
        yield part(
            f"to the {to}: Active until its first command passes (timer phase)", "ms", (s.phase_ms for s in there)
        )
        yield part(f"to the {to}: gap", "ms", (s.gap_ms for s in there))
