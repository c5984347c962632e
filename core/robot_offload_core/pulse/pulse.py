"""What a pulse process does: compose this side's beats, and remember the newest beat heard of each sender.

It never speaks for a silent control process: a grant goes out only if control renewed its permission within two beats,
and every beat states how long control has been silent.
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
"""Senders remembered at once; normally there is one, more are a fault (two identities, a restart)."""
JOIN_PERIODS = 0.5
"""A beat of the robot due within this time goes out when a beat of the cloud comes, which saves a wake-up."""
WAIT_PERIODS = 0.25
"""How long a due beat of the robot waits for a beat of the cloud; this does not delay the next one."""


@dataclass(frozen=True)
class Heard:
    """The newest beat of one sender. `version`: version of its form, which the sender surely understands."""

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
        side: our side.
        beat_period_s: time between two beats.
        incarnation: of our control process; "" until its first message.
        body: control's part of the beats.
        spoken_s: when control last sent it.
        sequence: of the next beat.
        due_s: when the next beat is due.
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
    """Take control's part of the beats, which control sent at `said_s` by this host's steady clock.

    `said_s` is when control sent it, not when it was read: the message may have waited in the inbox of a stopped pulse
    process, and must not make a permission look fresh.
    """
    return replace(pulse, incarnation=incarnation, body=body, spoken_s=said_s)


def hear(pulse: Pulse, beat: Beat, arrived_s: float) -> tuple[Pulse, bool]:
    """Take a beat; return whether it is newer than all earlier ones of its sender (then control must see it).

    Order is by send time, not by sequence: the steady clock of the sender's host goes on when only its pulse process
    restarts. Beats of foreign uids and of our own side are ignored.
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
    """Return when the next beat is due after one at `now_s`; beats missed in a stall are not sent in a burst."""
    period_s = pulse.beat_period_s
    return min(now_s, max(pulse.due_s, now_s - WAIT_PERIODS * period_s)) + period_s


def joins(pulse: Pulse, arrived_s: float) -> bool:
    """Return whether to send the next beat now, with the beat that was heard at `arrived_s`.

    Only the robot does so: two sides that answer each other would beat as fast as the link allows.
    """
    heard = partner(pulse)
    if pulse.side is not Site.ROBOT or heard is None or heard.arrived_s != arrived_s:
        return False
    return arrived_s >= pulse.due_s - JOIN_PERIODS * pulse.beat_period_s


def wake_s(pulse: Pulse) -> float:
    """Return when the next beat goes out without one to join: when it is due, on the robot a little later."""
    waited_s = WAIT_PERIODS * pulse.beat_period_s if pulse.side is Site.ROBOT else 0.0
    return pulse.due_s + waited_s


def partner(pulse: Pulse) -> Heard | None:
    """Return the sender that this side addresses: the one named by control, else the one heard last."""
    named = pulse.body.cloud if isinstance(pulse.body, Permission) else pulse.body.serves if pulse.body else ""
    matching = next((h for h in pulse.heard if h.incarnation == named), None)
    return matching or (pulse.heard[-1] if pulse.heard else None)


def _echo(pulse: Pulse, now_s: float) -> Echo | None:
    heard = partner(pulse)
    if heard is None:
        return None
    hold_us = max(0, round((now_s - heard.arrived_s) * 1e6))
    return Echo(heard.incarnation, heard.sequence, heard.sent_us, hold_us)
