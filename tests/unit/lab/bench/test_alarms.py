from robot_offload_lab.bench.analysis import alarms
from robot_offload_lab.bench.analysis.alarms import QuietStretch
from robot_offload_lab.bench.analysis.share import cloud_share, stays
from robot_offload_lab.judge.measures import Interval
from tests.unit.lab.bench.stories import placed


def watch(*seen: object, start_s: float = 100.0, end_s: float = 160.0) -> QuietStretch:
    return QuietStretch(start_s, end_s, tuple(seen))  # type: ignore[arg-type]


def test_a_sudden_takeover_is_an_alarm_and_a_decision_of_the_latency_rule_is_none():
    seen = watch(
        placed(90, "cloud"), placed(110, "robot", 91.0, "HeartbeatLost"), placed(112, "cloud"),
        placed(130, "robot", None, "LatencyTooHigh"), placed(131, "cloud"),
    )  # fmt: skip
    assert [(leave.t_s, leave.sudden) for leave in alarms.leaves(seen)] == [(10.0, True), (30.0, False)]


def test_what_happened_outside_the_watch_is_not_counted():
    seen = watch(placed(80, "cloud"), placed(90, "robot", 91.0), placed(95, "cloud"), placed(170, "robot", 91.0))
    assert alarms.leaves(seen) == ()


def test_a_stay_that_goes_on_is_open_and_repeated_announcements_do_not_split_it():
    found = stays([placed(1, "cloud"), placed(1, "cloud"), placed(5, "robot"), placed(6, "cloud")], "cloud")
    assert found == (Interval(1, 5), Interval(6, float("inf")))


def test_there_is_no_share_of_no_time():
    assert cloud_share([placed(1, "cloud")], []) is None
