import pytest

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload_lab.bench.analysis import detect
from robot_offload_lab.bench.analysis.cuts import Cut
from robot_offload_lab.bench.analysis.detect import DetectionAccount, Judged, Variant
from robot_offload_lab.bench.groups.detect import DetectionRun, runs
from robot_offload_lab.bench.plan import FULL, QUICK
from robot_offload_lab.bench.resource import offload
from robot_offload_lab.bench.rivals import BOND, LIVELINESS, MESSAGE, RivalReport
from robot_offload_lab.judge.measures import Interval

VARIANT = Variant("warm", "Warm standby, beats every 20 ms", "5ms each way")
QUIET = Interval(0.0, 60.0)
CUTS = [Cut(1, "both", 5.0, 100.0, 105.0), Cut(2, "both", 1.5, 110.0, 111.5)]


def told(rival: str, lost_s: float, back_s: float) -> list[RivalReport]:
    return [RivalReport(lost_s, rival, True), RivalReport(back_s, rival, False)]


def test_a_rival_notices_a_cut_when_it_first_tells_a_loss_and_is_back_when_it_tells_so_after_the_mending():
    said = [*told("liveliness", 100.15, 105.2), *told("liveliness", 110.05, 111.6)]
    judged = detect.rival(LIVELINESS, said, CUTS, None)
    assert judged.noticed == (pytest.approx(150.0), pytest.approx(50.0))
    assert judged.back == (pytest.approx(200.0), pytest.approx(100.0))
    assert judged.alarms is None


def test_a_cut_shorter_than_a_rivals_patience_says_nothing_of_it():
    judged = detect.rival(BOND, told("bond", 103.9, 105.1), CUTS, None)
    assert judged.noticed == (pytest.approx(3900.0),)


def test_what_is_told_of_another_cut_does_not_count():
    judged = detect.rival(MESSAGE, told("message", 110.1, 111.6), CUTS, None)
    assert judged.noticed == (None, pytest.approx(100.0))


def test_a_loss_told_without_a_cut_is_a_false_alarm():
    said = [*told("message", 10.0, 10.1), *told("message", 20.0, 20.1), *told("message", 100.1, 105.1)]
    assert detect.rival(MESSAGE, said, CUTS, QUIET).alarms == 2


@pytest.mark.parametrize(
    ("count", "seconds", "words"),
    [(2, 60.0, "120 per hour, in 1.0 minutes"), (0, 60.0, "none in 1.0 minutes: below 180 per hour")],
)
def test_a_rate_of_alarms_says_how_long_was_watched(count: int, seconds: float, words: str):
    assert detect.per_hour(count, seconds) == words


def test_ours_is_compared_with_dds_liveliness_of_the_same_run():
    ours = Judged(detect.OURS, (80.0, 90.0), (400.0, None), 0, (120.0, None))
    beside = Judged(LIVELINESS.title, (160.0, 180.0), (100.0, 100.0), 3)
    outcome = detect.outcome("realtime", [DetectionAccount(VARIANT, QUIET, (ours, beside))], "")
    figures = {figure.name: figure for figure in outcome.figures}
    assert figures["warm_0_noticed_p50"].ratio == pytest.approx(0.5)
    assert figures["warm_0_gap_p50"].count == 1
    assert figures["warm_0_gap_p50"].note == "highest 120 ms; 1 missed"
    assert figures["warm_1_alarms"].value == 3
    assert {sample["detector"] for sample in outcome.samples} == {detect.OURS, LIVELINESS.title}


def test_rivals_that_could_not_run_are_named_with_the_reason():
    outcome = detect.outcome("realtime", [], "network namespaces need root")
    assert [figure.note for figure in outcome.figures] == ["not run: network namespaces need root"] * 3


@pytest.mark.parametrize("one", runs(FULL), ids=lambda one: one.case.name)
def test_every_case_is_a_resource_with_its_standby_and_heartbeat(one: DetectionRun):
    spec = RobotOffload.model_validate(offload(one.case).model_dump(by_alias=True)).spec
    assert spec.switching.heartbeat_period_ms == one.heartbeat_ms
    assert spec.switching.loss_timeout_ms == one.silence_ms
    assert spec.nodes[0].standby.robot == one.case.standby


def test_the_long_form_has_more_cases_and_each_has_a_name_of_its_own():
    assert set(runs(QUICK)) < set(runs(FULL))
    assert len({one.case.name for one in runs(FULL)}) == len(runs(FULL))
