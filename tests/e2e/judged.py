"""What a recording at the consumer must show, whatever happened to the link, with the figures of the story."""

from __future__ import annotations

from robot_offload_lab.judge.busy import TIMING, busy, counted
from robot_offload_lab.judge.invariants import Violation, gap_limit_ms, violations
from robot_offload_lab.judge.measures import Measures
from robot_offload_lab.judge.streams import quantile
from tests.e2e.figures import figure


def judged(measures: Measures, label: str = "") -> Measures:
    """Prints the figures of a recording; returns it.

    Args:
        measures: of the recording.
        label: before each name, where a story has several recordings.
    """
    before = f"{label}: " if label else ""
    gaps = [gap.length_ms for stream in measures.streams.values() for gap in stream.gaps]
    arrivals = [each for stream in measures.streams.values() for each in stream.arrivals]
    ages = [each.age_s * 1e3 for each in arrivals if each.site == "cloud"]
    figure(f"{before}messages from the cloud", measures.messages_passed["cloud"])
    figure(f"{before}messages from the robot", measures.messages_passed["robot"])
    figure(f"{before}switches", len(measures.switches))
    for name in ("duplicates", "reordered", "stale"):
        count = sum(len(getattr(stream, name)) for stream in measures.streams.values())
        figure(f"{before}{name}", count)
    figure(f"{before}lost in a stay", sum(stream.lost for stream in measures.streams.values()))
    figure(f"{before}longest silence", max(gaps, default=None), "ms")
    figure(f"{before}silence that is explained", gap_limit_ms(measures.recording), "ms")
    figure(f"{before}age of a cloud message p50", quantile(ages, 0.5), "ms")
    figure(f"{before}age of a cloud message p99", quantile(ages, 0.99), "ms")
    share = measures.cloud_share_of_good_time
    if share is not None:
        figure(f"{before}cloud in charge of the good time", share * 100.0, "%")
    return measures


class BrokenPromiseError(AssertionError):
    """What no busy machine explains: a story that raises it is never run again."""


def assert_faultless(measures: Measures, *, but: frozenset[str] = frozenset()) -> None:
    """No broken promise of the switching protocol.

    Args:
        measures: of the recording.
        but: kinds of violations that the story brings about itself, see `invariants`.

    Raises:
        BrokenPromiseError: something else than silence came through, or did not.
        AssertionError: it was silent for too long, on a machine that gave both agents their processor.
    """
    why_busy = busy(measures.recording)
    figure("too busy to judge time", int(bool(why_busy)))
    found = [each for each in counted(violations(measures), why_busy) if each.kind not in but]
    if not {each.kind for each in found} <= TIMING:
        raise BrokenPromiseError(told(found))
    assert not found, told(found)


def told(found: list[Violation]) -> str:
    """Violations as sentences."""
    return "\n".join(f"{each.kind} at {each.t_s:.3f} s: {each.text}" for each in found)
