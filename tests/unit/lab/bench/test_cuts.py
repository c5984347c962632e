import random
from collections import Counter
from dataclasses import replace

import pytest

from robot_offload_lab.bench.analysis import cuts
from robot_offload_lab.bench.analysis.cuts import Cut, CutAccount
from robot_offload_lab.bench.groups.cuts import CASE, order_of_cuts
from robot_offload_lab.bench.plan import QUICK
from tests.unit.lab.bench.stories import START_S, active, arrivals, cloud_beat, every, placed, recording

CUT = Cut(1, "both", 2.0, cut_s=110.0, healed_s=112.0)


def account(**changes: object) -> CutAccount:
    """Cut at 110 s; the cloud's last command passes 4 ms later, the decision falls at 110.092 s."""
    cloud = arrivals("cloud", 1, [*every(104.004, 110.0, 0.02), 110.004])
    robot = arrivals("robot", 1, every(110.13, 112.9, 0.05))
    again = arrivals("cloud", 1000, every(112.91, 119.0, 0.02))
    seen = [
        placed(START_S + 1, "cloud"),
        placed(110.092, "robot", silent_ms=90.5, reason="HeartbeatLost"),
        active(110.1),
        cloud_beat(111.0, echo_age_s=1.0),
        cloud_beat(112.3, echo_age_s=2.3),
        cloud_beat(112.4, echo_age_s=0.01, serves=""),
        cloud_beat(112.5, echo_age_s=0.015),
        placed(112.9, "cloud"),
    ]
    whole = CutAccount((CUT,), recording(cloud, robot, again, end_s=120.0), tuple(seen), (), 0.15, 0.25)
    return replace(whole, **changes)


def test_a_cut_is_taken_apart_and_its_parts_make_up_the_gap():
    (fall,) = cuts.falls(account())
    assert fall.reason == "HeartbeatLost"
    assert fall.noticed_ms == pytest.approx(92.0)
    assert fall.detection_ms == 90.5
    assert fall.before_ms == pytest.approx(110.0015e3 - 110.004e3)
    assert fall.activation_ms == pytest.approx(8.0)
    assert fall.phase_ms == pytest.approx(30.0)
    assert fall.gap_ms == pytest.approx(126.0)
    assert fall.before_ms + fall.detection_ms + fall.activation_ms + fall.phase_ms == pytest.approx(fall.gap_ms)


def test_a_cut_of_one_direction_that_the_latency_rule_noticed_first_has_a_gap_but_no_detection():
    placements = (placed(START_S + 1, "cloud"), placed(110.131, "robot", None, "LatencyTooHigh"))
    (fall,) = cuts.falls(account(robot=placements))
    assert fall.gap_ms == pytest.approx(126.0)
    assert fall.noticed_ms == pytest.approx(131.0)
    assert (fall.detection_ms, fall.before_ms, fall.activation_ms) == (None, None, None)


def test_the_first_good_beat_echoes_in_time_and_comes_from_a_cloud_that_serves_us():
    (fall,) = cuts.falls(account())
    assert fall.first_good_beat_ms == pytest.approx(500.0)
    assert fall.back_ms == pytest.approx(900.0)


def test_a_cut_that_nobody_noticed_has_no_gap_and_is_told_in_the_table():
    unnoticed = account(robot=(placed(START_S, "cloud"),))
    (fall,) = cuts.falls(unnoticed)
    assert fall.gap_ms is None
    gap = cuts.outcome(CASE, "realtime", unnoticed).figures[0]
    assert (gap.value, gap.note) == (None, "1 cuts without a takeover")


def test_garbage_among_the_mirrored_beats_is_passed_over():
    heard = replace(cloud_beat(112.1, 0.01), text="no beat")
    (fall,) = cuts.falls(account(robot=(*account().robot, heard)))
    assert fall.first_good_beat_ms == pytest.approx(500.0)


def test_the_limits_are_those_of_the_settings_and_the_share_is_of_the_good_time():
    figures = {figure.name: figure for figure in cuts.outcome(CASE, "realtime", account()).figures}
    assert (figures["gap_both_p99"].must, figures["gap_both_p99"].aim) == (190.0, 170.0)
    assert figures["heal_2s_p90"].value == pytest.approx(0.5)
    # Good: 100 to 110 and 112 to 120 s; in charge: 101 to 110 and 112.9 to 120 s.
    assert figures["cloud_share"].value == pytest.approx((9 + 7.1) / 18 * 100)
    assert figures["stale"].value == figures["repeated"].value == 0


def test_a_share_below_the_limit_is_missed():
    late = account(robot=(placed(START_S + 15, "cloud"),))
    share = next(f for f in cuts.outcome(CASE, "realtime", late).figures if f.name == "cloud_share")
    assert not share.met(share.must)


def test_every_kind_of_cut_is_ordered_as_often_as_planned():
    ordered = Counter(order_of_cuts(QUICK, random.Random(1)))
    assert ordered == {
        ("both", 2.0): QUICK.cuts, ("both", 10.0): QUICK.long_cuts, ("up", 2.0): QUICK.one_way,
        ("down", 2.0): QUICK.one_way,
    }  # fmt: skip
