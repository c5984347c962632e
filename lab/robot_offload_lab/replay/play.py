"""One policy on one recording, moment by moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from robot_offload.errors import InputError
from robot_offload_core.fence.token import Site
from robot_offload_core.words.reasons import Verdict
from robot_offload_lab.replay.contract import Decision, SwitchingPolicy
from robot_offload_lab.replay.costs import Change
from robot_offload_lab.replay.heartbeats import NEVER_US, Heartbeats

Progress = Callable[[int], None]
"""Called now and then with the number of beats replayed since the last call."""
PROGRESS_BEATS = 1000


def moments(beats: Heartbeats) -> Iterator[tuple[int, list[int]]]:
    """Yield every moment (microseconds) at which an agent looks, and the beats (indices) whose echoes arrive then.

    These are the beginning of each period and the arrivals of echoes. Echoes of one instant come together: after a
    stall an agent reads everything that has arrived before it judges.
    """
    arrivals = [(at_us, index) for index, at_us in enumerate(beats.arrived_us.tolist()) if at_us != NEVER_US]
    arrivals.append((NEVER_US, -1))
    position = 0
    for tick_us in beats.sent_us.tolist():
        while (at_us := arrivals[position][0]) <= tick_us:
            together = []
            while arrivals[position][0] == at_us:
                together.append(arrivals[position][1])
                position += 1
            if at_us < tick_us:
                yield at_us, together
            else:
                yield tick_us, together
                break
        else:
            yield tick_us, []


def play(policy: SwitchingPolicy, beats: Heartbeats, progress: Progress | None = None) -> tuple[Change, ...]:
    """Return where `policy` acts on this recording; before the first change the robot acts."""
    changes: list[Change] = []
    site, seen = Site.ROBOT, 0
    sent_us = beats.sent_us.tolist()
    for at_us, echoes in moments(beats):
        for index in echoes:
            policy.heard(sent_us[index] / 1e6, at_us / 1e6)
        answer = policy.place(at_us / 1e6)
        wanted = answer if isinstance(answer, Site) else _site(answer)
        if wanted is not site:
            site = wanted
            reason, message = (
                (str(answer.reason), answer.message) if isinstance(answer, (Decision, Verdict)) else ("", "")
            )
            changes.append(Change(at_us, site, reason, message))
        if progress and at_us >= (seen + PROGRESS_BEATS) * beats.period_us:
            progress(PROGRESS_BEATS)
            seen += PROGRESS_BEATS
    return tuple(changes)


def _site(answer: object) -> Site:
    if isinstance(answer, (Decision, Verdict)):
        return answer.site
    try:
        return Site(str(answer).lower())
    except ValueError:
        raise InputError(f"the policy answered {answer!r}; place must return 'robot' or 'cloud'") from None
