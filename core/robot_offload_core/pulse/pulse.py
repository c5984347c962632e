"""What a pulse process does: composes this side's beats, remembers the newest heard of each sender.

It vouches for nobody: a grant goes out only while control has renewed its permission within two beats, and every
beat says how long control has been silent.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Site
from robot_offload_core.words.beats import (
    PERMISSION_BEATS,
    PREVIOUS,
    VERSION,
    Beat,
    CloudReport,
    Echo,
    Permission,
    veil,
)
from robot_offload_core.words.replace import replace

MAX_SENDERS = 4
"""Senders remembered at once; more than one is a fault (two identities, a restart), not the normal case."""
JOIN_PERIODS = 0.5
"""A beat of the robot that is due so soon goes out with one of the cloud that has just come: it saves a wake-up."""
WAIT_PERIODS = 0.25
"""One of the robot that is due waits so long for a beat of the cloud; the next one is due no later because of that."""


@dataclass(frozen=True)
class Heard:
    """The newest beat of one sender. `version`: of its form; the sender understands that one for sure."""

    incarnation: str
    sequence: int
    sent_us: int
    arrived_s: float
    version: str = VERSION


@dataclass(frozen=True)
class Pulse:
    """State of a pulse process.

    Attributes:
        uid: of the RobotOffload; beats of others are ignored.
        side: ours.
        beat_period_s: distance of two beats.
        incarnation: of our control process; "" until it has spoken.
        body: what control wants said.
        spoken_s: when control last spoke.
        sequence: of the next beat.
        due_s: when it is due.
        heard: newest beat per sender, most recent last.
    """

    uid: str
    side: Site
    beat_period_s: float
    incarnation: str = ""
    body: Permission | CloudReport | None = None
    spoken_s: float | None = None
    sequence: int = 0
    heard: tuple[Heard, ...] = ()
    due_s: float = 0.0


def speak(pulse: Pulse, incarnation: str, body: Permission | CloudReport, said_s: float) -> Pulse:
    """Return control renewed what it wants said, at `said_s` by this host's steady clock.

    That is when control said it, not when it was read: a word may have waited in the inbox of a pulse process that was
    stopped, and a permission must not look fresh because of that.
    """
    return replace(pulse, incarnation=incarnation, body=body, spoken_s=said_s)


def hear(pulse: Pulse, beat: Beat, arrived_s: float) -> tuple[Pulse, bool]:
    """Take in a beat; return whether it is newer than all of its sender's before (then control must see it).

    Order is by send time, not by sequence: the steady clock of the sender's host goes on when only its pulse process
    restarts. Foreign uids and our own side's beats are not ours.
    """
    if beat.uid != pulse.uid or beat.sender is pulse.side or not beat.incarnation:
        return pulse, False
    known = next((h for h in pulse.heard if h.incarnation == beat.incarnation), None)
    if known is not None and beat.sent_us <= known.sent_us:
        return pulse, False
    others = tuple(h for h in pulse.heard if h is not known)[-(MAX_SENDERS - 1) :]
    newest = Heard(beat.incarnation, beat.sequence, beat.sent_us, arrived_s, beat.version)
    return replace(pulse, heard=(*others, newest)), True


def compose(pulse: Pulse, now_s: float, wall_us: int) -> tuple[Pulse, Beat]:
    """Return the next beat. `wall_us` is this host's system clock minus its steady clock."""
    silent_s = None if pulse.spoken_s is None else now_s - pulse.spoken_s
    body = pulse.body
    if (
        isinstance(body, Permission)
        and (body.granted or body.presence)
        and (silent_s is None or silent_s > PERMISSION_BEATS * pulse.beat_period_s)
    ):
        body = replace(body, granted=False, in_charge=False, presence=False)
    heard = partner(pulse)
    age_us = -1 if silent_s is None else max(0, round(silent_s * 1e6))
    beat = Beat(
        uid=pulse.uid,
        sender=pulse.side,
        incarnation=pulse.incarnation,
        sequence=pulse.sequence,
        sent_us=round(now_s * 1e6),
        wall_us=wall_us,
        control_age_us=age_us,
        echo=_echo(pulse, now_s),
        body=body,
        version=VERSION if heard is None else heard.version,
    )
    if pulse.side is Site.CLOUD and beat.version != PREVIOUS:
        beat = veil(beat)
    return replace(pulse, sequence=pulse.sequence + 1, due_s=_next_due_s(pulse, now_s)), beat


def _next_due_s(pulse: Pulse, now_s: float) -> float:
    """Return when a beat is due after one at `now_s`; after a stall beats are not caught up in a burst."""
    period_s = pulse.beat_period_s
    return min(now_s, max(pulse.due_s, now_s - WAIT_PERIODS * period_s)) + period_s


def joins(pulse: Pulse, arrived_s: float) -> bool:
    """Return whether the next beat goes out with the one that has just been heard, at `arrived_s`.

    On the robot alone: two sides that answer each other would beat as fast as the link is.
    """
    heard = partner(pulse)
    if pulse.side is not Site.ROBOT or heard is None or heard.arrived_s != arrived_s:
        return False
    return arrived_s >= pulse.due_s - JOIN_PERIODS * pulse.beat_period_s


def wake_s(pulse: Pulse) -> float:
    """Return when the next beat goes out by itself: when it is due, on the robot a little later."""
    waited_s = WAIT_PERIODS * pulse.beat_period_s if pulse.side is Site.ROBOT else 0.0
    return pulse.due_s + waited_s


def partner(pulse: Pulse) -> Heard | None:
    """Return the sender that this side talks to: the one named by control, else the one heard last."""
    named = pulse.body.cloud if isinstance(pulse.body, Permission) else pulse.body.serves if pulse.body else ""
    matching = next((h for h in pulse.heard if h.incarnation == named), None)
    return matching or (pulse.heard[-1] if pulse.heard else None)


def _echo(pulse: Pulse, now_s: float) -> Echo | None:
    heard = partner(pulse)
    if heard is None:
        return None
    hold_us = max(0, round((now_s - heard.arrived_s) * 1e6))
    return Echo(heard.incarnation, heard.sequence, heard.sent_us, hold_us)
