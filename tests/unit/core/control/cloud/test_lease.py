"""The cloud's side: it acts on a lease of its own clock, anchored to a beat that it sent itself."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.control.cloud import lease
from robot_offload_core.control.cloud.lease import Cloud, CloudNodes, Command, RobotBeat, SetReport, StandChanged
from robot_offload_core.fence.lease import Lease
from robot_offload_core.fence.token import Token, presence
from robot_offload_core.words.beats import Beat, CloudReport, Echo, Permission
from robot_offload_core.words.events import Acting, CloudData, SetEgress, Tick
from robot_offload_core.words.settings import Settings
from tests.unit.core.builders import CLOUD, LEASE_US, NOW_S, ROBOT, SETTINGS, STRANGER, many, permission, robot_beat, us

LEASE_S = SETTINGS.lease_s
ASLEEP = Cloud(Lease(CLOUD), SETTINGS, ready=True, stepped_s=NOW_S - 0.010)


def heard(cloud: Cloud, beat: Beat, now_s: float = NOW_S) -> Cloud:
    return lease.step(cloud, RobotBeat(beat, now_s), now_s)[0]


def acting(epoch: int = 4, now_s: float = NOW_S) -> Cloud:
    """A cloud that has just been granted `epoch` in answer to its beat of 10 ms ago."""
    return heard(ASLEEP, robot_beat(now_s - 0.005, now_s - 0.010, body=permission(epoch)), now_s)


def stepped(cloud: Cloud, to_s: float) -> Cloud:
    """Time goes on until `to_s` in ticks of 10 ms; nothing is heard."""
    now_s = cloud.stepped_s if cloud.stepped_s is not None else NOW_S
    while now_s < to_s - 1e-9:
        now_s = min(to_s, now_s + 0.010)
        cloud = lease.step(cloud, Tick(), now_s)[0]
    return cloud


def levels(cloud: Cloud, now_s: float = NOW_S) -> tuple[SetEgress, Acting, CloudReport]:
    """What is told at each step."""
    commands: list[Command] = lease.step(cloud, Tick(), now_s)[1]
    egress, active, tell = commands[:3]
    assert isinstance(egress, SetEgress)
    assert isinstance(active, Acting)
    assert isinstance(tell, SetReport)
    return egress, active, tell.report


def egress_of(cloud: Cloud, token: Token) -> SetEgress:
    """What may leave under a grant of `token`, which contains presence."""
    return SetEgress(token, cloud.lease.end_s, False, presence(token.robot, CLOUD), cloud.lease.presence_end_s)


# -- the anchor


def test_a_lease_ends_a_lease_after_the_echoed_beat_was_sent() -> None:
    cloud = acting()
    assert cloud.lease.end_s == pytest.approx(NOW_S - 0.010 + LEASE_S)
    assert lease.holds_lease(cloud, cloud.lease.end_s - 1e-6)
    assert not lease.holds_lease(cloud, cloud.lease.end_s)


def test_a_grant_that_waited_in_a_buffer_is_worthless() -> None:
    cloud = heard(ASLEEP, robot_beat(NOW_S - 0.3, NOW_S - 0.3))
    assert not lease.holds_lease(cloud, NOW_S)


def test_a_robot_may_grant_less_than_the_lease_but_not_more() -> None:
    for granted_us, length_s in ((100_000, 0.100), (10 * LEASE_US, LEASE_S)):
        cloud = heard(ASLEEP, robot_beat(echo_s=NOW_S - 0.010, body=permission(lease_us=granted_us)))
        assert cloud.lease.end_s == pytest.approx(NOW_S - 0.010 + length_s)


def test_a_later_grant_that_echoes_an_older_beat_shortens_nothing() -> None:
    cloud = heard(acting(), robot_beat(NOW_S, NOW_S - 0.100), NOW_S + 0.001)
    assert cloud.lease.end_s == acting().lease.end_s


@pytest.mark.parametrize(
    "beat",
    [
        robot_beat(echo_s=None),
        robot_beat(echo=Echo(STRANGER, 1, us(NOW_S), 0)),
        robot_beat(body=permission(granted=False)),
        robot_beat(body=permission(cloud=STRANGER)),
        robot_beat(body=permission(cloud="")),
        robot_beat(body=None),
        robot_beat(body=CloudReport()),
    ],
    ids=["no echo", "another's beat", "not granted", "to another cloud", "to nobody", "bare", "no permission"],
)
def test_what_is_no_grant_to_us_gives_no_lease(beat: Beat) -> None:
    cloud = heard(ASLEEP, beat)
    assert not lease.holds_lease(cloud, NOW_S)
    assert levels(cloud)[:2] == (SetEgress(None, 0.0), Acting(False))


@pytest.mark.parametrize(
    "beat",
    [
        robot_beat(NOW_S, echo_s=None),
        robot_beat(NOW_S, body=permission(cloud=STRANGER)),
        robot_beat(NOW_S, body=permission(9, cloud=STRANGER)),
        robot_beat(NOW_S, body=None),
        robot_beat(NOW_S, body=permission(3)),
        robot_beat(NOW_S - 1.0, NOW_S, body=permission(5)),
    ],
    ids=["no echo", "another cloud", "another cloud, newer epoch", "bare", "older epoch", "overtaken by a newer beat"],
)
def test_what_is_no_grant_to_us_renews_no_lease(beat: Beat) -> None:
    cloud = heard(acting(), beat, NOW_S + 0.005)
    assert (cloud.epoch, cloud.lease.end_s) == (4, acting().lease.end_s)


# -- epochs


def test_a_newer_epoch_ends_the_older_lease_at_once_even_without_a_grant() -> None:
    cloud = heard(acting(4), robot_beat(NOW_S, body=permission(5, granted=False)), NOW_S + 0.001)
    assert (cloud.epoch, cloud.lease.granted) == (5, False)
    assert not lease.holds_lease(cloud, NOW_S + 0.001)


def test_a_newer_grant_replaces_the_token_from_one_message_to_the_next() -> None:
    cloud = heard(acting(4), robot_beat(NOW_S, NOW_S - 0.010, body=permission(5)), NOW_S + 0.001)
    assert levels(cloud, NOW_S + 0.001)[0] == egress_of(cloud, Token(ROBOT, 5, CLOUD))


def test_presence_outlives_the_charge_and_ends_with_its_own_lease() -> None:
    cloud = heard(
        acting(4), robot_beat(NOW_S, NOW_S - 0.010, body=Permission(5, False, CLOUD, LEASE_US, presence=True))
    )
    egress = levels(cloud, NOW_S + 0.001)[0]
    assert (egress.token, egress.presence) == (None, presence(ROBOT, CLOUD))
    assert levels(cloud, cloud.lease.presence_end_s)[0] == SetEgress(None, 0.0)


def test_a_newer_grant_without_a_living_echo_does_not_inherit_the_older_lease() -> None:
    cloud = heard(acting(4), robot_beat(NOW_S, echo_s=None, body=permission(5)), NOW_S + 0.001)
    assert not lease.holds_lease(cloud, NOW_S + 0.001)


def test_late_words_of_an_older_epoch_do_not_bring_it_back() -> None:
    cloud = heard(acting(5), robot_beat(NOW_S, NOW_S - 0.001, body=permission(4)), NOW_S + 0.001)
    assert (cloud.epoch, cloud.lease.end_s) == (5, acting(5).lease.end_s)


# -- pauses


def test_a_pause_voids_the_lease() -> None:
    cloud, _ = lease.step(acting(), Tick(), NOW_S + SETTINGS.pause_s + 0.001)
    assert not lease.holds_lease(cloud, NOW_S + SETTINGS.pause_s + 0.001)


def test_a_pause_is_noticed_by_whatever_comes_first_after_it() -> None:
    after_s = NOW_S + SETTINGS.pause_s + 0.001
    cloud = heard(acting(), robot_beat(NOW_S + 0.015, NOW_S + 0.010), after_s)
    assert not lease.holds_lease(cloud, after_s), "the grant in the inbox echoes a beat of before the pause"


def test_after_a_pause_a_grant_counts_again_if_it_echoes_a_beat_of_after_it() -> None:
    after_s = NOW_S + 0.2
    cloud, _ = lease.step(acting(), Tick(), after_s)
    cloud = heard(cloud, robot_beat(after_s + 0.010, after_s - 0.001), after_s + 0.020)
    assert not lease.holds_lease(cloud, after_s + 0.020)
    cloud = heard(cloud, robot_beat(after_s + 0.030, after_s + 0.005), after_s + 0.040)
    assert cloud.lease.end_s == pytest.approx(after_s + 0.005 + LEASE_S)


def test_ordinary_ticks_are_no_pause() -> None:
    assert lease.holds_lease(stepped(acting(), NOW_S + 0.2), NOW_S + 0.2)


# -- identities


def test_a_second_robot_is_refused_while_the_first_is_live_and_told_so() -> None:
    cloud = heard(acting(), robot_beat(NOW_S, NOW_S - 0.001, incarnation=STRANGER, body=permission(9)), NOW_S + 0.001)
    assert (cloud.robot, cloud.epoch, cloud.lease.end_s) == (ROBOT, 4, acting().lease.end_s)
    told = levels(cloud, NOW_S + 0.001)[2]
    assert (told.serves, told.refused) == (ROBOT, STRANGER)
    assert lease.situation(cloud, NOW_S + 0.001)[0] == "DuplicateIdentity"


def test_a_refusal_is_forgotten_when_the_second_robot_is_gone() -> None:
    cloud, now_s = acting(), NOW_S + 0.001
    cloud = heard(cloud, robot_beat(now_s, incarnation=STRANGER), now_s)
    while now_s < NOW_S + SETTINGS.robot_live_s + 0.1:
        now_s += 0.020
        cloud = heard(cloud, robot_beat(now_s - 0.005, now_s - 0.010), now_s)
    assert cloud.refused == ""
    assert lease.situation(cloud, now_s)[0] == "Acting"


def test_a_robot_that_was_silent_for_long_enough_gives_way_to_its_next_incarnation() -> None:
    cloud = stepped(acting(), NOW_S + SETTINGS.robot_live_s + 0.011)
    now_s = NOW_S + SETTINGS.robot_live_s + 0.020
    assert (cloud.robot, cloud.epoch) == ("", 0)
    cloud = heard(cloud, robot_beat(1.0, now_s - 0.010, incarnation=STRANGER, body=permission(1)), now_s)
    assert levels(cloud, now_s)[0] == egress_of(cloud, Token(STRANGER, 1, CLOUD))


def test_a_silent_robot_is_served_again_when_it_returns() -> None:
    cloud = stepped(acting(), NOW_S + 5.0)
    cloud = heard(cloud, robot_beat(NOW_S + 5.0, NOW_S + 4.999, body=permission(6)), NOW_S + 5.0)
    assert (cloud.robot, cloud.epoch) == (ROBOT, 6)
    assert lease.holds_lease(cloud, NOW_S + 5.0)


def test_robots_are_told_apart_by_incarnation_never_by_age_of_their_clock() -> None:
    cloud = stepped(heard(ASLEEP, robot_beat(NOW_S, body=permission(4))), NOW_S + 3.0)
    cloud = heard(cloud, robot_beat(2.0, NOW_S + 2.99, incarnation=STRANGER, body=permission(1)), NOW_S + 3.0)
    assert (cloud.robot, cloud.epoch) == (STRANGER, 1)


# -- what is told


def test_the_egress_is_told_the_whole_token_and_the_end_of_the_lease() -> None:
    assert levels(acting())[0] == egress_of(acting(), Token(ROBOT, 4, CLOUD))


def test_a_granted_cloud_wakes_its_nodes_but_does_not_act_before_they_are_ready() -> None:
    waking = heard(replace(ASLEEP, ready=False), robot_beat())
    egress, active, told = levels(waking)
    assert (active, told.acting, told.ready, told.epoch) == (Acting(True), False, False, 4)
    assert egress.token is not None, "outputs of the first awake nodes are what the collector waits for"
    ready, commands = lease.step(waking, CloudNodes(True), NOW_S)
    assert levels(ready)[2].acting
    assert StandChanged("Acting", "Acting under epoch 4") in commands


def test_when_the_lease_has_run_out_the_nodes_go_to_sleep_and_nothing_leaves() -> None:
    cloud = stepped(acting(), NOW_S + LEASE_S)
    egress, active, told = levels(cloud, NOW_S + LEASE_S)
    assert (egress, active) == (SetEgress(None, 0.0), Acting(False))
    assert (told.acting, told.epoch, told.serves) == (False, 4, ROBOT)


def test_ages_are_told_in_microseconds_and_never_as_minus_one() -> None:
    cloud, _ = lease.step(ASLEEP, CloudData(0.012, (0.050, None, float("inf"), 0.0)), NOW_S)
    told = levels(cloud)[2]
    assert (told.data_age_us, told.input_ages_us) == (12_000, (50_000, -1, -1, 0))


def test_before_the_data_session_was_heard_its_age_is_never() -> None:
    assert levels(ASLEEP)[2].data_age_us == -1


def test_each_change_is_told_once_with_its_reason() -> None:
    cloud, told = lease.start(CLOUD, SETTINGS), []
    script: list[tuple[float, lease.Event]] = [
        (0.0, Tick()),
        (0.01, RobotBeat(robot_beat(NOW_S, NOW_S + 0.005), NOW_S + 0.01)),
        (0.02, CloudNodes(True)),
        *((0.03 + tick * 0.01, Tick()) for tick in range(30)),
        (0.34, RobotBeat(robot_beat(NOW_S + 0.33, body=permission(5, granted=False)), NOW_S + 0.34)),
        *((0.35 + tick * 0.01, Tick()) for tick in range(110)),
    ]
    for after_s, event in script:
        cloud, commands = lease.step(cloud, event, NOW_S + after_s)
        told += [command for command in commands if isinstance(command, StandChanged)]
    assert [(decided.reason, decided.message) for decided in told] == [
        ("Waking", "Bringing up the nodes for epoch 4"),
        ("Acting", "Acting under epoch 4"),
        ("LeaseExpired", "The lease of epoch 4 has run out"),
        ("Asleep", "The robot acts"),
    ]


# -- whatever happens

beats_at = st.builds(
    lambda back_s, echo_back_s, epoch, granted, ours, robot: (back_s, echo_back_s, epoch, granted, ours, robot),
    st.floats(0, 0.5), st.one_of(st.none(), st.floats(0, 0.5)), st.integers(1, 6), st.booleans(),
    st.booleans(), st.sampled_from([ROBOT, ROBOT, ROBOT, STRANGER]),
)  # fmt: skip
happenings = st.one_of(beats_at, st.booleans(), st.none())
histories = st.lists(st.tuples(st.floats(0, 0.1) | st.floats(0, 2), happenings), max_size=40)


@many
@given(histories)
def test_no_lease_outlives_the_beat_that_it_echoes_whatever_is_heard(
    history: list[tuple[float, tuple[float, float | None, int, bool, bool, str] | bool | None]],
) -> None:
    cloud, now_s = lease.start(CLOUD, SETTINGS), NOW_S
    echoed_s: dict[Token, float] = {}  # token -> newest beat of ours that a grant of it has echoed
    for wait_s, happening in history:
        now_s += wait_s
        event: lease.Event = Tick()
        if isinstance(happening, bool):
            event = CloudNodes(happening)
        elif happening is not None:
            back_s, echo_back_s, epoch, granted, ours, robot = happening
            echo_s = None if echo_back_s is None else now_s - echo_back_s
            body = permission(epoch, granted=granted, cloud=CLOUD if ours else STRANGER)
            event = RobotBeat(robot_beat(now_s - back_s, echo_s, incarnation=robot, body=body), now_s)
            if granted and ours and echo_s is not None:
                token = Token(robot, epoch, CLOUD)
                echoed_s[token] = max(echoed_s.get(token, 0.0), echo_s)
        before = cloud
        cloud, commands = lease.step(cloud, event, now_s)
        egress = commands[0]
        assert isinstance(egress, SetEgress)
        assert cloud.robot != before.robot or cloud.epoch >= before.epoch
        if egress.token is not None:
            assert now_s < egress.lease_end_s <= echoed_s[egress.token] + LEASE_S + 2e-6
            assert egress.token == Token(cloud.robot, cloud.epoch, CLOUD)
        assert commands[1] == Acting(egress.token is not None)


def test_the_egress_knows_whether_the_cloud_is_in_charge_or_only_gets_ready() -> None:
    ready = acting()
    assert not levels(ready)[0].in_charge
    beat = robot_beat(body=permission(in_charge=True), sent_us=us(NOW_S + 0.001))
    ready, _ = lease.step(ready, RobotBeat(beat, NOW_S), NOW_S)
    assert levels(ready)[0].in_charge
    newer = robot_beat(body=permission(5), sent_us=us(NOW_S + 0.002))
    ready, _ = lease.step(ready, RobotBeat(newer, NOW_S), NOW_S)
    assert not levels(ready)[0].in_charge


def test_a_robot_whose_beats_are_a_second_apart_is_not_forgotten_between_them() -> None:
    slow = Settings(beat_period_s=1.0, loss_timeout_s=2.5, lease_s=5.0, max_command_age_s=2.0, tolerance_s=0.1)
    slow.check()
    cloud = lease.start(CLOUD, slow)
    for beat in range(5):
        now_s = NOW_S + beat * 1.05
        sent = robot_beat(now_s - 0.010, now_s - 0.030, body=permission(lease_us=us(5.0)))
        cloud, _ = lease.step(cloud, RobotBeat(sent, now_s), now_s)
        for tick in range(1, 50):
            cloud, _ = lease.step(cloud, Tick(), now_s + tick * 0.020)
            assert cloud.robot == ROBOT
