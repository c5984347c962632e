"""Whether anything left the cloud agent after its lease, by an observer at the cloud agent's listeners.

An envelope may leave until `lease` after the robot *sent* the newest grant of its token that had reached the cloud.
Both are on one host here, so their clocks are the same. The moment of leaving is taken at the observer, which is later
than the real one; the cloud's own count begins earlier (with the send time of the beat that the grant echoes). So the
reckoning errs against the product.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_core.fence import envelope
from robot_offload_core.fence.token import Token
from robot_offload_core.words import beats
from robot_offload_core.words.beats import Permission
from robot_offload_core.words.veil import veil_token
from robot_offload_lab.bench.observed import Departed, Observation, Reached, only

CLOCK_MARGIN_S: Final = 0.001
ORDER_SLACK_S: Final = 0.005
"""Beats and envelopes reach the observer in two sessions: a grant may be seen this much after its first use."""


@dataclass(frozen=True)
class Grant:
    """A grant that reached the cloud at t_s; sent_s by the robot."""

    t_s: float
    sent_s: float
    token: Token


@dataclass(frozen=True)
class Leaving:
    """An envelope and how long after the end of its lease it left; negative: within it, None: never granted."""

    t_s: float
    output: str
    token: Token
    late_s: float | None

    @property
    def violates(self) -> bool:
        """Whether it left too late."""
        return self.late_s is None or self.late_s > CLOCK_MARGIN_S


def grants(observations: Iterable[Observation]) -> tuple[Grant, ...]:
    """Return the grants among the beats that reached the cloud."""
    return tuple(_grants(only(Reached, observations)))


def _grants(reached: Iterable[Reached]) -> Iterator[Grant]:
    for one in reached:
        try:
            beat = beats.decode(one.text)
        except beats.BeatError:
            continue
        if isinstance(beat.body, Permission) and beat.body.granted:
            yield Grant(one.t_s, beat.sent_us / 1e6, beat.body.token(beat.incarnation))


def leavings(observations: Sequence[Observation], lease_s: float, begin_s: float) -> tuple[Leaving, ...]:
    """Return every envelope that left from `begin_s` on, against its lease.

    Args:
        observations: of the observer.
        lease_s: `switching.lease`.
        begin_s: before it the observer may not have heard the grants in force.
    """
    given: dict[Token, tuple[list[float], list[float]]] = {}
    for grant in grants(observations):
        arrived, sent = given.setdefault(grant.token, ([], []))
        arrived.append(grant.t_s)
        sent.append(max(grant.sent_s, sent[-1] if sent else 0.0))
    named = {veil_token(token): token for token in given}
    found = []
    for departed in only(Departed, observations):
        if departed.t_s < begin_s:
            continue
        said = envelope.decode(bytes.fromhex(departed.header)).token
        token = named.get(said, said)
        arrived, sent = given.get(token, ([], []))
        known = bisect.bisect_right(arrived, departed.t_s + ORDER_SLACK_S)
        late_s = departed.t_s - (sent[known - 1] + lease_s) if known else None
        found.append(Leaving(departed.t_s, departed.output, token, late_s))
    return tuple(found)
