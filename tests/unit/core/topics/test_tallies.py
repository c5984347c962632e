"""Counts of the link and of the changes."""

from __future__ import annotations

from robot_offload_core.control.tallies import LATENCY_MS, LinkTally
from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Link
from robot_offload_core.topics.tallies import GAP_MS, SWITCH_S, SwitchSilence, bucket
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.replace import replace

TIMEOUT_S = 0.09
LINK = Link("cloud", 10.0, 9.99, 0.012, (0.012,), None, 100, 100, 1)
LOST = Decided(Site.ROBOT, 4, Phase.ROBOT, Verdict(Site.ROBOT, Reason.HEARTBEAT_LOST, "lost"), True, 0.095)


def test_a_value_belongs_to_the_least_bound_that_holds_it() -> None:
    assert [bucket(GAP_MS, value) for value in (0, 25, 25.1, 5000)] == [0, 0, 1, len(GAP_MS)]


def test_beats_lost_are_those_that_a_newer_one_has_overtaken() -> None:
    tally = LinkTally()
    tally.look(LINK, 10.0, TIMEOUT_S)
    tally.look(replace(LINK, last_sequence=105, received=4, echo_sent_s=10.1), 10.1, TIMEOUT_S)
    tally.look(replace(LINK, last_sequence=105, received=4, echo_sent_s=10.1), 10.2, TIMEOUT_S)
    assert (tally.received, tally.lost) == (4, 2)
    assert sum(tally.latency) == 2
    assert tally.latency[bucket(LATENCY_MS, 12)] == 2


def test_another_sender_and_one_that_begins_again_lose_nothing() -> None:
    tally = LinkTally()
    tally.look(LINK, 10.0, TIMEOUT_S)
    tally.look(replace(LINK, first_sequence=3, last_sequence=3, received=1), 10.1, TIMEOUT_S)
    tally.look(replace(LINK, peer="another", first_sequence=900, last_sequence=900, received=1), 10.2, TIMEOUT_S)
    assert (tally.received, tally.lost) == (3, 0)


def test_a_beat_soon_after_a_takeover_makes_it_a_false_alarm_once() -> None:
    tally = LinkTally()
    tally.look(LINK, 10.0, TIMEOUT_S)
    tally.decided(LOST, "cloud", 10.1)
    for now_s in (10.12, 10.14):
        tally.look(replace(LINK, last_sequence=round(now_s * 100), received=round(now_s * 100)), now_s, TIMEOUT_S)
    assert (tally.losses, tally.false_alarms, tally.silence_ms) == (1, 1, 95.0)
    tally.decided(LOST, "cloud", 11.0)
    tally.look(replace(LINK, last_sequence=2000, received=1900), 12.0, TIMEOUT_S)
    assert (tally.losses, tally.false_alarms) == (2, 1)
    assert tally.changeovers == {("robot", Reason.HEARTBEAT_LOST.value): 2}


def test_a_decision_that_changes_nobody_in_charge_is_no_changeover() -> None:
    tally = LinkTally()
    tally.decided(replace(LOST, switched=False), "cloud", 10.1)
    assert not tally.changeovers


def test_the_silence_of_a_change_is_the_longest_that_touches_it_and_is_said_when_it_is_over() -> None:
    silence = SwitchSilence(Site.CLOUD)
    silence.ended(9.0, 9.9)
    assert silence.known(20.0) is None  # nobody has changed over
    silence.passes(Site.ROBOT, 10.0)
    assert silence.known(20.0) is None  # nobody has spoken since
    silence.ended(9.9, 10.04)
    silence.ended(10.04, 10.09)
    assert silence.known(10.0 + SWITCH_S) is None
    assert silence.known(11.1) == (Site.ROBOT, 10.0, 140.0)
    silence.ended(10.9, 12.9)  # an output that came back late
    silence.ended(12.9, 19.0)  # later silences have other causes
    assert silence.known(20.0) == (Site.ROBOT, 10.0, 2000.0)
    silence.passes(Site.ROBOT, 21.0)
    assert silence.known(21.0) == (Site.ROBOT, 10.0, 2000.0)
    silence.passes(Site.CLOUD, 30.0)
    assert silence.known(31.5) is None
