"""Recorded round-trip times, read from files.

Two formats, told apart by their first line; empty lines and lines that begin with `#` are skipped in both:

* text: one round-trip time in milliseconds per line, measured back to back (the next request leaves when the
  answer to the previous one has come), so that the sum of the lines is the time that has passed;
* CSV: the header `t_s,rtt_ms`, then the moment of sending and the round-trip time; an empty `rtt_ms` is a
  lost request.

`made_up` writes some.
"""

from __future__ import annotations

import bisect
import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from robot_offload.errors import InputError

CSV_HEADER = "t_s,rtt_ms"

STALL_FLOOR_MS = 40.0
"""A shorter round trip is never a stall, however quick the link usually is."""

STALL_FACTOR = 3.0
"""A round trip longer than this many medians is a stall: everything is held and released at its end."""


class TraceError(InputError, ValueError):
    """A trace that cannot be used; the message begins with `file:line:` and states what to write instead."""


@dataclass(frozen=True)
class Trace:
    """A recording of round-trip times, replayed from its beginning when it ends.

    Attributes:
        name: its name in reports, usually the file's name.
        times_s: when each request was sent, strictly increasing, the first at 0.
        rtts_ms: the round-trip time of each request, None for a lost one.
        duration_s: length of the recording.
    """

    name: str
    times_s: tuple[float, ...]
    rtts_ms: tuple[float | None, ...]
    duration_s: float

    def __post_init__(self) -> None:
        if not self.times_s or len(self.times_s) != len(self.rtts_ms):
            raise TraceError(f"{self.name}: a trace needs as many times as round-trip times, and at least one")
        if self.times_s[0] != 0.0 or self.times_s[-1] >= self.duration_s:
            raise TraceError(f"{self.name}: the first sample must be at 0 s and the last before the end")
        if all(rtt is None for rtt in self.rtts_ms):
            raise TraceError(f"{self.name}: every request was lost; there is nothing to replay")

    @cached_property
    def median_ms(self) -> float:
        """The median round-trip time of the requests that were answered."""
        return statistics.median(rtt for rtt in self.rtts_ms if rtt is not None)

    @cached_property
    def stall_ms(self) -> float:
        """A round trip longer than this is a stall, not a property of the path."""
        return max(STALL_FLOOR_MS, STALL_FACTOR * self.median_ms)

    @cached_property
    def _releases_s(self) -> tuple[float, ...]:
        """For each sample, when the last stall begun by then ends (0 before the first stall)."""
        ends_s = (
            t_s + rtt_ms / 1000 if rtt_ms is not None and rtt_ms > self.stall_ms else 0.0
            for t_s, rtt_ms in zip(self.times_s, self.rtts_ms, strict=True)
        )
        return tuple(itertools.accumulate(ends_s, max))

    def one_way_ms(self, t_s: float) -> float | None:
        """Return the delay of a packet sent at `t_s`, in either direction.

        Half of the round-trip time of that moment. During a stall a packet is held until the stall's end, and
        none sent later arrives before that. A lost request means no link until the next request. Between the
        end of a stall and the next request (only possible in the CSV format) half of the median counts.

        Args:
            t_s: seconds since the beginning of the replay, at least 0; beyond the end the trace repeats.

        Returns:
            The delay in milliseconds, None while nothing gets through.
        """
        within_s = t_s % self.duration_s
        index = bisect.bisect_right(self.times_s, within_s) - 1
        rtt_ms = self.rtts_ms[index]
        if rtt_ms is None:
            return None
        held_ms = (self._releases_s[index] - within_s) * 1000
        if rtt_ms > self.stall_ms:
            return held_ms if held_ms > 0 else self.median_ms / 2
        return max(rtt_ms / 2, held_ms)


def load_trace(path: Path) -> Trace:
    """Read a trace in either format.

    Raises:
        TraceError: the file cannot be read or is not a trace; names file and line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise TraceError(f"{path}: cannot read the trace: {reason}") from error
    return parse_trace(text, name=path.name, source=str(path))


def parse_trace(text: str, *, name: str, source: str | None = None) -> Trace:
    """Parse the text of a trace in either format.

    Args:
        text: the content of the file.
        name: the name of the trace.
        source: what error messages call the file; the name, if not given.

    Raises:
        TraceError: names source and line.
    """
    source = source or name
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise TraceError(f"{source}:1: the trace is empty; write one round-trip time in ms per line")
    first_number, first = lines[0]
    if first.replace(" ", "") == CSV_HEADER:
        return _from_csv(lines[1:], name, source, header_line=first_number)
    if "," in first:
        raise TraceError(f"{source}:{first_number}: a trace with commas must begin with the line '{CSV_HEADER}'")
    return _from_text(lines, name, source)


def _from_text(lines: Sequence[tuple[int, str]], name: str, source: str) -> Trace:
    times_s: list[float] = []
    rtts_ms: list[float] = []
    elapsed_s = 0.0
    for number, line in lines:
        rtt_ms = _positive_ms(line, f"{source}:{number}")
        times_s.append(elapsed_s)
        rtts_ms.append(rtt_ms)
        elapsed_s += rtt_ms / 1000
    return Trace(name, tuple(times_s), tuple(rtts_ms), elapsed_s)


def _from_csv(lines: Sequence[tuple[int, str]], name: str, source: str, *, header_line: int) -> Trace:
    times_s: list[float] = []
    rtts_ms: list[float | None] = []
    for number, line in lines:
        where = f"{source}:{number}"
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != 2:
            raise TraceError(f"{where}: expected two values '{CSV_HEADER}', found {line!r}")
        t_s = _number(cells[0], where, "t_s")
        if times_s and t_s <= times_s[-1]:
            raise TraceError(f"{where}: t_s must grow from line to line, but {t_s:g} follows {times_s[-1]:g}")
        times_s.append(t_s)
        rtts_ms.append(_positive_ms(cells[1], where) if cells[1] else None)
    if all(rtt is None for rtt in rtts_ms):
        raise TraceError(f"{source}:{header_line}: no line after the header has a round-trip time")
    # The last sample lasts as long as the others usually do, but at least until its answer has come.
    steps_s = [later - earlier for earlier, later in itertools.pairwise(times_s)]
    usual_s = statistics.median(steps_s) if steps_s else 0.0
    end_s = times_s[-1] + max(usual_s, (rtts_ms[-1] or 0.0) / 1000)
    origin_s = times_s[0]
    return Trace(name, tuple(t_s - origin_s for t_s in times_s), tuple(rtts_ms), end_s - origin_s)


def _number(text: str, where: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise TraceError(f"{where}: {what} must be a number, found {text!r}") from None
    if not math.isfinite(value):
        raise TraceError(f"{where}: {what} must be finite, found {text!r}")
    return value


def _positive_ms(text: str, where: str) -> float:
    value = _number(text, where, "the round-trip time in ms")
    if value <= 0:
        raise TraceError(f"{where}: a round-trip time must be above 0 ms, found {text!r}")
    return value
