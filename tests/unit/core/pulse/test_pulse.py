"""The pulse process: it says how long control has been silent, and grants nothing in its name."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site
from robot_offload_core.pulse import pulse
from robot_offload_core.pulse.pulse import MAX_SENDERS, Heard, Pulse
from robot_offload_core.words import beats
from robot_offload_core.words.beats import PERMISSION_BEATS, Beat, CloudReport, Permission
from tests.unit.core.builders import (
    BEAT_S,
    CLOUD,
    NOW_S,
    ROBOT,
    STRANGER,
    UID,
    acting_report,
    cloud_beat,
    many,
    permission,
    robot_beat,
    us,
)

SILENT = Pulse(UID, Site.ROBOT, BEAT_S)
DUE = replace(SILENT, due_s=NOW_S)


def speaking(said_s: float = NOW_S, body: Permission | CloudReport | None = None) -> Pulse:
    """The robot's pulse process, to which control spoke at `said_s`."""
    return pulse.speak(SILENT, ROBOT, body or permission(), said_s)


def composed(state: Pulse, now_s: float = NOW_S) -> Beat:
    return pulse.compose(state, now_s, wall_us=0)[1]


# -- when a beat goes out


def test_a_beat_goes_out_each_period_on_the_robot_a_little_later_than_due() -> None:
    state, _ = pulse.compose(DUE, NOW_S, 0)
    assert state.due_s == pytest.approx(NOW_S + BEAT_S)
    assert pulse.wake_s(state) == pytest.approx(NOW_S + 1.25 * BEAT_S)
    late, _ = pulse.compose(state, pulse.wake_s(state), 0)
    assert late.due_s == pytest.approx(NOW_S + 2 * BEAT_S), "and the next one no later for that"
    assert pulse.wake_s(replace(state, side=Site.CLOUD)) == pytest.approx(NOW_S + BEAT_S)


def test_after_a_stall_beats_are_not_caught_up() -> None:
    state, _ = pulse.compose(DUE, NOW_S, 0)
    state, _ = pulse.compose(state, NOW_S + 1.0, 0)
    assert state.due_s > NOW_S + 1.0 + BEAT_S / 2


@pytest.mark.parametrize(("after_s", "goes"), [(0.002, False), (0.009, False), (0.011, True), (0.024, True)])
def test_a_beat_that_is_due_soon_goes_with_one_of_the_cloud(after_s: float, goes: bool) -> None:
    state, _ = pulse.compose(DUE, NOW_S, 0)
    state, newer = pulse.hear(state, cloud_beat(), NOW_S + after_s)
    assert newer
    assert pulse.joins(state, NOW_S + after_s) is goes
    assert not pulse.joins(state, NOW_S + after_s + 0.001), "none of the cloud came just then"


def test_the_cloud_does_not_answer_beats_with_beats() -> None:
    state, _ = pulse.compose(replace(DUE, side=Site.CLOUD), NOW_S, 0)
    state, newer = pulse.hear(state, robot_beat(), NOW_S + BEAT_S)
    assert newer
    assert not pulse.joins(state, NOW_S + BEAT_S)


# -- composing


def test_before_control_has_spoken_a_beat_is_bare() -> None:
    assert composed(SILENT) == Beat(UID, Site.ROBOT, "", 0, us(NOW_S), 0, -1, None, None)


def test_beats_are_numbered_from_zero() -> None:
    state, numbers = SILENT, []
    for _ in range(4):
        state, beat = pulse.compose(state, NOW_S, 0)
        numbers.append(beat.sequence)
    assert numbers == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("silent_s", "granted"), [(0.0, True), (BEAT_S, True), (0.039, True), (0.041, False), (5.0, False)]
)
def test_a_grant_goes_out_only_while_control_renewed_it_within_two_beats(silent_s: float, granted: bool) -> None:
    beat = composed(speaking(NOW_S - silent_s))
    assert beat.body == permission(granted=granted)
    assert beat.control_age_us == us(silent_s)


@many
@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 0.030)), max_size=30))
def test_no_grant_is_older_than_two_beats_whenever_control_speaks(steps: list[tuple[bool, float]]) -> None:
    state, now_s, said_s = SILENT, NOW_S, None
    for speaks, wait_s in steps:
        now_s += wait_s
        if speaks:
            state, said_s = pulse.speak(state, ROBOT, permission(), now_s), now_s
        state, beat = pulse.compose(state, now_s, 0)
        granted = isinstance(beat.body, Permission) and beat.body.granted
        assert granted == (said_s is not None and now_s - said_s <= PERMISSION_BEATS * BEAT_S)


def test_a_word_counts_from_when_it_was_said_not_from_when_it_was_read() -> None:
    late = pulse.speak(SILENT, ROBOT, permission(), said_s=NOW_S - 1.0)  # it waited in the inbox of a stopped process
    assert composed(late).body == permission(granted=False)


def test_a_withdrawn_grant_is_back_with_the_next_word_of_control() -> None:
    state, beat = pulse.compose(speaking(NOW_S - 1.0), NOW_S, 0)
    assert beat.body == permission(granted=False)
    assert composed(pulse.speak(state, ROBOT, permission(), NOW_S)).body == permission()


def test_a_report_of_the_cloud_goes_on_and_shows_how_old_it_is() -> None:
    state = replace(speaking(NOW_S - 1.0, acting_report(4)), side=Site.CLOUD)
    beat = composed(state)
    assert beats.unveil(beat, ROBOT).body == acting_report(4)
    assert beat.control_age_us == 1_000_000


# -- hearing


@pytest.mark.parametrize(
    "beat",
    [cloud_beat(uid="wheelchair-8"), robot_beat(), cloud_beat(incarnation="")],
    ids=["another RobotOffload", "our own side", "control is not up"],
)
def test_beats_that_are_not_for_us_change_nothing(beat: Beat) -> None:
    assert pulse.hear(SILENT, beat, NOW_S) == (SILENT, False)


def test_a_beat_is_remembered_and_passed_on_to_control() -> None:
    beat = cloud_beat(NOW_S - 0.005)
    state, newer = pulse.hear(SILENT, beat, NOW_S)
    assert newer
    assert state == replace(SILENT, heard=(Heard(CLOUD, beat.sequence, beat.sent_us, NOW_S),))


@many
@given(st.lists(st.integers(0, 30), min_size=1, max_size=40))
def test_of_beats_in_any_order_and_number_only_ever_newer_ones_are_passed_on(order: list[int]) -> None:
    state, passed = SILENT, []
    for index, number in enumerate(order):
        beat = cloud_beat(100.0 + number * BEAT_S, sequence=number)
        state, newer = pulse.hear(state, beat, 200.0 + index * BEAT_S)
        if newer:
            passed.append(number)
    assert passed == sorted(set(passed))
    assert passed[-1] == max(order)
    assert state.heard[0].sequence == max(order)


def test_after_a_restart_of_the_other_pulse_process_its_beats_count_on() -> None:
    state, _ = pulse.hear(SILENT, cloud_beat(NOW_S - 1.0, sequence=50_000), NOW_S - 1.0)
    state, newer = pulse.hear(state, cloud_beat(NOW_S, sequence=0), NOW_S)
    assert newer
    assert [h.sequence for h in state.heard] == [0]


def test_beats_of_before_the_restart_that_come_late_are_dropped() -> None:
    state, _ = pulse.hear(SILENT, cloud_beat(NOW_S, sequence=0), NOW_S)
    assert pulse.hear(state, cloud_beat(NOW_S - 1.0, sequence=50_000), NOW_S) == (state, False)


def test_only_the_last_few_senders_are_remembered() -> None:
    state = SILENT
    for digit in "0123456789":
        state, _ = pulse.hear(state, cloud_beat(incarnation=digit * 32), NOW_S)
    assert [h.incarnation[0] for h in state.heard] == list("6789")
    assert len(state.heard) == MAX_SENDERS


# -- echoing


def test_an_echo_names_the_newest_beat_and_how_long_it_was_held() -> None:
    state, _ = pulse.hear(SILENT, cloud_beat(NOW_S - 0.050, sequence=7), NOW_S - 0.030)
    echo = composed(state).echo
    assert echo is not None
    assert (echo.incarnation, echo.sequence, echo.sent_us) == (CLOUD, 7, us(NOW_S - 0.050))
    assert echo.hold_us == 30_000


def two_senders(state: Pulse) -> Pulse:
    state, _ = pulse.hear(state, cloud_beat(), NOW_S - 0.020)
    return pulse.hear(state, cloud_beat(incarnation=STRANGER), NOW_S - 0.010)[0]


def test_of_two_senders_the_one_that_control_talks_to_is_echoed() -> None:
    echo = composed(two_senders(speaking())).echo
    assert echo is not None
    assert echo.incarnation == CLOUD


def test_of_two_senders_the_last_one_is_echoed_while_control_names_none() -> None:
    echo = composed(two_senders(speaking(body=permission(cloud="")))).echo
    assert echo is not None
    assert echo.incarnation == STRANGER


def test_the_cloud_echoes_the_robot_that_it_serves() -> None:
    state = replace(speaking(body=acting_report(4)), side=Site.CLOUD)
    state, _ = pulse.hear(state, robot_beat(), NOW_S - 0.020)
    state, _ = pulse.hear(state, robot_beat(incarnation=STRANGER), NOW_S - 0.010)
    echo = beats.unveil(composed(state), ROBOT).echo
    assert echo is not None
    assert echo.incarnation == ROBOT


def test_nothing_that_the_cloud_says_names_a_robot_by_its_incarnation() -> None:
    state = replace(speaking(body=acting_report(4, refused=STRANGER)), side=Site.CLOUD, incarnation=CLOUD)
    state, _ = pulse.hear(state, robot_beat(), NOW_S - 0.020)
    text = beats.encode(composed(state))
    assert ROBOT not in text
    assert STRANGER not in text


def test_a_partner_of_the_version_before_is_spoken_to_as_it_speaks() -> None:
    state = replace(speaking(body=acting_report(4, shape="0123abcd")), side=Site.CLOUD, incarnation=CLOUD)
    state, _ = pulse.hear(state, replace(robot_beat(), version=beats.PREVIOUS), NOW_S - 0.020)
    said = beats.decode(beats.encode(composed(state)))
    assert said.version == beats.PREVIOUS
    assert said.body == acting_report(4)
    state, _ = pulse.hear(state, robot_beat(NOW_S), NOW_S)
    assert composed(state).version == beats.VERSION, "it was upgraded"


def test_a_stranger_of_the_version_before_does_not_unveil_the_robot_served() -> None:
    state = replace(speaking(body=acting_report(4)), side=Site.CLOUD, incarnation=CLOUD)
    state, _ = pulse.hear(state, robot_beat(), NOW_S - 0.020)
    state, _ = pulse.hear(state, replace(robot_beat(incarnation=STRANGER), version=beats.PREVIOUS), NOW_S - 0.010)
    assert ROBOT not in beats.encode(composed(state))


def test_a_partner_that_was_never_heard_is_not_echoed() -> None:
    assert composed(speaking()).echo is None
