import pytest

from robot_offload_lab.bench.analysis import hot, silence
from robot_offload_lab.bench.analysis.alarms import QuietStretch
from robot_offload_lab.bench.analysis.cuts import Cut, CutAccount
from robot_offload_lab.bench.groups.hot import CASE
from tests.unit.lab.bench.stories import answered, arrivals, every, placed, recording


def account(*cuts: Cut) -> CutAccount:
    """To the robot at 102 s and back at 103 s by hand; a cut at 104.005 s that the robot notices by silence."""
    cloud = arrivals("cloud", 1, [*every(101.0, 102.0, 0.02), *every(103.01, 104.01, 0.02)])
    robot = arrivals("robot", 1, [*every(102.015, 103.0, 0.05), *every(104.045, 105.0, 0.05)])
    seen = (
        answered(101.97, "robot"), placed(102.0, "robot"), answered(102.99, "cloud"), placed(103.0, "cloud"),
        placed(104.044, "robot", reason="OutputSilent"),
    )  # fmt: skip
    return CutAccount(cuts, recording(cloud, robot), seen, (), 0.15, 0.25)


CUT = Cut(1, "both", 0.5, 104.005, 104.5)


def test_the_gap_of_a_cut_is_told_with_what_noticed_it():
    found = {figure.name: figure for figure in hot.outcome(CASE, "normal", account(CUT)).figures}
    assert found["gap_p99"].value == pytest.approx(55.0)
    assert found["gap_p99"].note == "1 OutputSilent"
    assert (found["gap_p99"].must, found["gap_p99"].aim) == (75.0, 65.0)
    assert found["faults"].value == 0


def test_the_gap_of_a_commanded_change_lies_between_the_two_sides():
    assert [(c.to, pytest.approx(c.gap_ms)) for c in hot.changes(account(CUT))] == [("robot", 35.0), ("cloud", 45.0)]
    found = {figure.name: figure for figure in hot.outcome(CASE, "normal", account(CUT)).figures}
    assert (found["change_longest"].value, found["change_longest"].must) == (pytest.approx(45.0), 53.0)


def test_the_samples_of_cuts_and_changes_fit_into_one_table():
    samples = hot.outcome(CASE, "normal", account(CUT)).samples
    assert [(s["kind"], s["to"]) for s in samples] == [("cut", "robot"), ("change", "robot"), ("change", "cloud")]
    assert len({tuple(sample) for sample in samples}) == 1


def test_only_takeovers_by_silence_count_and_the_others_are_told():
    seen = (
        placed(101.0, "cloud"), placed(102.0, "robot", reason="OutputSilent"), placed(103.0, "cloud"),
        placed(104.0, "robot", 91.0, reason="HeartbeatLost"),
    )  # fmt: skip
    figure = silence.outcome("normal", [(CASE, QuietStretch(100.0, 160.0, seen))]).figures[0]
    assert (figure.value, figure.must) == (1, 2)
    assert figure.note == "besides, the robot took over 1 times by HeartbeatLost; the limit is for 60 minutes"
