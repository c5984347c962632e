"""Compute link health from beats: age, loss, round trip, one-way estimates with their uncertainty, clock offset.

Decisions use only differences of one host's clock: round trip = now - sent(echoed beat) - hold time. One-way times and
the clock offset are estimated as in NTP (RFC 5905, section 8): the sample with the least round trip in a window bounds
the offset of the two clocks to within half that round trip.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.words.beats import Beat
from robot_offload_core.words.replace import replace

WINDOW_SAMPLES = 250
"""Round trips kept for quantiles: 5 s of beats at the default period."""
OFFSET_LIFE_S = 30.0
"""Even a better offset sample is replaced after this time, in which quartzes drift by up to 1.5 ms (50 ppm)."""


ROUNDING_S = 5e-6
"""Times in beats are whole microseconds."""


@dataclass(frozen=True)
class Offset:
    """The best offset sample at hand, with half its round trip as uncertainty. Seconds; peer minus own clock."""

    steady_s: float
    wall_s: float
    uncertainty_s: float
    taken_s: float


@dataclass(frozen=True)
class Link:
    """What is known of the link to one incarnation of the other side. Times on our steady clock, seconds.

    Attributes:
        peer: incarnation of the sender; "" for none.
        heard_s: arrival of the peer's newest beat.
        echo_sent_s: when we sent the newest beat that the peer has echoed; until then the loop was alive.
        round_trip_s: of the newest echo.
        window: the last round trips, oldest first.
        down_s: newest one-way estimate towards us; None before an offset is known.
        first_sequence, last_sequence, received: for the share of lost beats.
        offset: see Offset.
        sent_us: send time of the peer's newest beat, on its clock; -1: none was heard.
    """

    peer: str = ""
    heard_s: float | None = None
    echo_sent_s: float | None = None
    round_trip_s: float | None = None
    window: tuple[float, ...] = ()
    down_s: float | None = None
    first_sequence: int = 0
    last_sequence: int = 0
    received: int = 0
    offset: Offset | None = None
    sent_us: int = -1


@dataclass(frozen=True)
class Health:
    """A summary for people and for /diagnostics. Milliseconds; None where unknown."""

    age_ms: float | None
    loop_age_ms: float | None
    round_trip_p50_ms: float | None
    round_trip_p90_ms: float | None
    round_trip_p99_ms: float | None
    loss_share: float
    up_ms: float | None
    down_ms: float | None
    one_way_uncertainty_ms: float | None
    clock_offset_ms: float | None
    clock_uncertainty_ms: float | None


def is_news(link: Link, beat: Beat) -> bool:
    """Return whether a beat is newer than all earlier ones of its sender; late and duplicate copies are not.

    Order is by send time, not by sequence: the steady clock of the sender's host goes on when only its pulse process
    restarts. Our own pulse process drops copies too, but it forgets what it has heard when it restarts.
    """
    return beat.incarnation != link.peer or beat.sent_us > link.sent_us


def hear(link: Link, beat: Beat, ours: str, arrived_s: float, wall_us: int) -> Link:
    """Take a beat. `ours` is our incarnation: an echo of another incarnation's beat proves nothing.

    A beat of a new incarnation starts a new Link; a beat that is not news changes nothing.
    """
    if not is_news(link, beat):
        return link
    if beat.incarnation != link.peer:
        link = Link(peer=beat.incarnation, first_sequence=beat.sequence, last_sequence=beat.sequence - 1)
    sequence = beat.sequence
    if sequence < link.last_sequence:  # the sender's pulse process restarted and counts from 0 again
        link = replace(link, first_sequence=sequence, received=0)
    received = link.received + 1
    link = replace(link, heard_s=arrived_s, sent_us=beat.sent_us, last_sequence=sequence, received=received)
    echo = beat.echo
    if echo is None or echo.incarnation != ours:
        return link
    sent_s = echo.sent_us / 1e6
    round_trip_s = arrived_s - sent_s - echo.hold_us / 1e6
    if round_trip_s < 0 or (link.echo_sent_s is not None and sent_s < link.echo_sent_s):
        return link
    offset = _offset(link.offset, beat, sent_s, round_trip_s, arrived_s, wall_us)
    return replace(
        link,
        echo_sent_s=sent_s,
        round_trip_s=round_trip_s,
        window=(*link.window[-(WINDOW_SAMPLES - 1) :], round_trip_s),
        down_s=arrived_s - (beat.sent_us / 1e6 - offset.steady_s),
        offset=offset,
    )


def _offset(
    known: Offset | None, beat: Beat, sent_s: float, round_trip_s: float, arrived_s: float, wall_us: int
) -> Offset:
    assert beat.echo is not None
    walls_s, half_s = (beat.wall_us - wall_us) / 1e6, round_trip_s / 2
    there_s = beat.sent_us / 1e6
    heard_there_s = there_s - beat.echo.hold_us / 1e6
    steady_s = ((heard_there_s - sent_s) + (there_s - arrived_s)) / 2
    # Each sample bounds the offset: two that contradict each other show that a steady clock stood still (a paused VM).
    stood = known is not None and abs(steady_s - known.steady_s) > known.uncertainty_s + half_s + ROUNDING_S
    if known and not stood and half_s >= known.uncertainty_s and arrived_s - known.taken_s < OFFSET_LIFE_S:
        # A system clock that was set shows in this beat already; only the steady part needs a good sample.
        return known if known.wall_s == known.steady_s + walls_s else replace(known, wall_s=known.steady_s + walls_s)
    return Offset(steady_s, steady_s + walls_s, half_s, arrived_s)


def latency_s(link: Link, now_s: float, beat_period_s: float) -> float:
    """Return the present loop latency: the newest round trip, or more if echoes are overdue; inf without an echo.

    In a healthy loop the newest echoed beat is at most one round trip and two beat periods (one on each side) old. If
    it is older, the next echo has been under way for at least the age minus the two periods.
    """
    if link.round_trip_s is None or link.echo_sent_s is None:
        return float("inf")
    return max(link.round_trip_s, now_s - link.echo_sent_s - 2 * beat_period_s)


def clock_excess_s(link: Link) -> float:
    """Return how far apart the two system clocks are at least; 0 while the uncertainty explains the difference."""
    if link.offset is None:
        return 0.0
    return max(0.0, abs(link.offset.wall_s) - link.offset.uncertainty_s)


def health(link: Link, now_s: float) -> Health:
    """Return the summary at `now_s`."""
    ordered = sorted(link.window)
    expected = link.last_sequence - link.first_sequence + 1
    offset = link.offset
    down = link.down_s
    up = None if down is None or link.round_trip_s is None else max(0.0, link.round_trip_s - down)
    return Health(
        age_ms=_ms(None if link.heard_s is None else now_s - link.heard_s),
        loop_age_ms=_ms(None if link.echo_sent_s is None else now_s - link.echo_sent_s),
        round_trip_p50_ms=_ms(quantile(ordered, 0.5)),
        round_trip_p90_ms=_ms(quantile(ordered, 0.9)),
        round_trip_p99_ms=_ms(quantile(ordered, 0.99)),
        loss_share=0.0 if expected <= 0 else max(0.0, 1 - link.received / expected),
        up_ms=_ms(up),
        down_ms=_ms(down),
        one_way_uncertainty_ms=_ms(offset.uncertainty_s if offset else None),
        clock_offset_ms=_ms(offset.wall_s if offset else None),
        clock_uncertainty_ms=_ms(offset.uncertainty_s if offset else None),
    )


def quantile(ordered: list[float] | tuple[float, ...], share: float) -> float | None:
    """Return the value that `share` of the ascending `ordered` values do not exceed (nearest rank); None if empty."""
    if not ordered:
        return None
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]


def _ms(value_s: float | None) -> float | None:
    return None if value_s is None else round(value_s * 1e3, 2)
