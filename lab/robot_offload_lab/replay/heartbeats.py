"""What a recorded link does to heartbeats: when the echo of each one is back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robot_offload_lab.links.recorded import Trace, TraceError

Micros = NDArray[np.int64]
NEVER_US: Final = np.iinfo(np.int64).max
"""The arrival time of a lost beat."""


@dataclass(frozen=True)
class Heartbeats:
    """One heartbeat at the beginning of each period, and when its echo is back. Times in whole microseconds.

    Attributes:
        name: of the recording.
        period_us: time between two beats.
        sent_us: when each beat left, from 0 on.
        arrived_us: when its echo was back, in the order of sending; NEVER_US for a lost one.
    """

    name: str
    period_us: int
    sent_us: Micros
    arrived_us: Micros

    @property
    def duration_us(self) -> int:
        """Length of the replay, in whole periods."""
        return len(self.sent_us) * self.period_us

    @cached_property
    def latency_us(self) -> Micros:
        """The loop latency of each beat; NEVER_US for a lost one."""
        lost = self.arrived_us == NEVER_US
        return np.where(lost, NEVER_US, self.arrived_us - self.sent_us)

    def good(self, limit_us: int) -> NDArray[np.bool_]:
        """Return for each period whether a beat sent in it is back within `limit_us`."""
        return self.latency_us <= limit_us


def derive(trace: Trace, period_s: float) -> Heartbeats:
    """Return the heartbeats that the link of `trace` would have carried.

    A sample lasts until the next request. A beat that leaves during a normal sample is back after that sample's
    round-trip time. During a stall (`Trace.stall_ms`: longer than 40 ms and three medians) it is held and back at the
    stall's end; after that end, until the next request (only possible in the CSV format), it takes a median. A lost
    request means no link until the next one: beats sent then never come back. No beat overtakes an earlier one.

    Raises:
        TraceError: the trace is shorter than two periods.
    """
    count = int(trace.duration_s / period_s + 1e-9)
    if count < 2:
        raise TraceError(f"{trace.name}: the recording is shorter than two heartbeats; record for some seconds")
    period_us = round(period_s * 1e6)
    sent_us = np.arange(count, dtype=np.int64) * period_us
    times_us = np.round(np.array(trace.times_s) * 1e6).astype(np.int64)
    lost_sample = np.array([rtt_ms is None for rtt_ms in trace.rtts_ms])
    rtts_us = np.array([round((rtt_ms or 0.0) * 1e3) for rtt_ms in trace.rtts_ms], dtype=np.int64)
    sample = np.searchsorted(times_us, sent_us, side="right") - 1
    rtt_us, lost = rtts_us[sample], lost_sample[sample]
    end_us = times_us[sample] + rtt_us
    after_stall_us = sent_us + round(trace.median_ms * 1e3)
    stalled_us = np.where(end_us > sent_us, end_us, after_stall_us)
    arrived_us = np.where(rtt_us > round(trace.stall_ms * 1e3), stalled_us, sent_us + rtt_us)
    in_order_us = np.maximum.accumulate(np.where(lost, 0, arrived_us))
    return Heartbeats(trace.name, period_us, sent_us, np.where(lost, NEVER_US, in_order_us))
