from pathlib import Path

import pytest

from robot_offload_lab.bench import observed
from robot_offload_lab.bench.observed import Answered, BeatHeard, Departed, Hop, Reached, Transition
from robot_offload_lab.judge.recording import PlacementChange

ALL = (
    PlacementChange(1.0, "cloud", 2, "LinkGood", phase="Cloud", since_s=0.9),
    PlacementChange(2.0, "robot", 3, "HeartbeatLost", "No beat", 90.5, "Robot", 1.9, "control"),
    Transition(2.1, "active"), Answered(3.0, 2.9, "cloud", True, "Switching"), BeatHeard(3.1, "1 x"),
    Departed(3.2, "command", "00ff"), Reached(3.3, "1 y"), Hop(3.4, 64, 10.1),
)  # fmt: skip


@pytest.mark.parametrize("observation", ALL)
def test_every_kind_comes_back_from_its_line(observation: observed.Observation):
    assert observed.LINES.decode(observed.LINES.encode(observation)) == observation


def test_an_unfinished_last_line_is_left_out(tmp_path: Path):
    path = tmp_path / "x.jsonl"
    path.write_text("".join(observed.LINES.encode(one) + "\n" for one in ALL) + '{"kind": "hop", "t')
    assert observed.read(path) == ALL


def test_an_observer_that_never_wrote_saw_nothing(tmp_path: Path):
    assert observed.read(tmp_path / "missing") == ()


@pytest.mark.parametrize("line", ["", "[]", "{}", '{"kind": "other"}', '{"kind": "hop"}', "null"])
def test_lines_that_are_no_observations_are_refused(line: str):
    with pytest.raises(ValueError):  # noqa: PT011 - json's own error is one too
        observed.LINES.decode(line)


def test_one_kind_can_be_picked_in_the_order_of_time():
    assert observed.only(PlacementChange, reversed(ALL)) == ALL[:2]
