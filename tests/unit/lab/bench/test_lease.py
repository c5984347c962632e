import pytest

from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Token
from robot_offload_lab.bench.analysis import lease
from robot_offload_lab.bench.observed import Departed, Reached
from tests.unit.lab.bench.stories import CLOUD, OTHER, ROBOT, grant

LEASE_S = 0.25


def left(t_s: float, epoch: int = 1, cloud: str = CLOUD) -> Departed:
    return Departed(t_s, "command", envelope.encode(Envelope(Token(ROBOT, epoch, cloud), 1, 0)).hex())


def reached(sent_s: float, after_s: float = 0.005, epoch: int = 1, granted: bool = True) -> Reached:
    return Reached(sent_s + after_s, grant(sent_s, epoch, granted))


def late_ms(*observations: Departed | Reached) -> list[float | None]:
    found = lease.leavings(observations, LEASE_S, begin_s=0.0)
    return [None if one.late_s is None else one.late_s * 1e3 for one in found]


def test_an_envelope_within_its_lease_is_none_too_late():
    assert late_ms(reached(10.0), left(10.2)) == [pytest.approx(-50.0)]
    (leaving,) = lease.leavings([reached(10.0), left(10.2)], LEASE_S, 0.0)
    assert not leaving.violates


def test_an_envelope_after_its_lease_violates_beyond_the_clock_margin():
    found = lease.leavings([reached(10.0), left(10.2505), left(10.252)], LEASE_S, 0.0)
    assert [leaving.violates for leaving in found] == [False, True]


def test_only_grants_that_had_reached_the_cloud_count():
    waited_in_a_buffer = reached(10.1, after_s=3.0)
    assert late_ms(reached(10.0), waited_in_a_buffer, left(10.3)) == [pytest.approx(50.0)]


def test_a_grant_seen_a_moment_after_its_first_use_counts():
    assert late_ms(reached(10.0, after_s=0.007), left(10.004)) == [pytest.approx(-246.0)]


def test_a_grant_of_another_token_lets_nothing_leave():
    assert late_ms(reached(10.0, epoch=2), left(10.1)) == [None]
    assert late_ms(reached(10.0), left(10.1, cloud=OTHER)) == [None]
    (leaving,) = lease.leavings([reached(10.0, epoch=2), left(10.1)], LEASE_S, 0.0)
    assert leaving.violates


def test_a_beat_without_a_grant_renews_nothing():
    assert late_ms(reached(10.0), reached(10.2, granted=False), left(10.3)) == [pytest.approx(50.0)]


def test_an_older_grant_that_comes_late_takes_nothing_back():
    assert late_ms(reached(10.1), reached(10.0, after_s=0.2), left(10.3)) == [pytest.approx(-50.0)]


def test_what_left_before_the_observer_was_there_is_not_judged():
    assert lease.leavings([left(9.0)], LEASE_S, begin_s=9.5) == ()


def test_garbage_on_the_way_to_the_cloud_is_no_grant():
    assert late_ms(Reached(10.0, "garbage"), left(10.1)) == [None]
