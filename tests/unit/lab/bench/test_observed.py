from pathlib import Path

import pytest

from robot_offload_lab.bench import observed
from robot_offload_lab.bench.observed import Answered, BeatHeard, Departed, Hop, Placed, Reached, Transition

ALL = (
    Placed(1.0, "cloud", "Cloud", 2, "LinkGood", 0.9, None),
    Placed(2.0, "robot", "Robot", 3, "HeartbeatLost", 1.9, 90.5),
    Transition(2.1, "active"), Answered(3.0, 2.9, "cloud", True, "Switching"), BeatHeard(3.1, "1 x"),
    Departed(3.2, "command", "00ff"), Reached(3.3, "1 y"), Hop(3.4, 64, 10.1),
)  # fmt: skip


@pytest.mark.parametrize("observation", ALL)
def test_every_kind_comes_back_from_its_line(observation: observed.Observation):
    assert observed.decode(observed.encode(observation)) == observation


def test_an_unfinished_last_line_is_left_out(tmp_path: Path):
    path = tmp_path / "x.jsonl"
    path.write_text("".join(observed.encode(one) + "\n" for one in ALL) + '{"kind": "hop", "t')
    assert observed.read(path) == ALL


def test_an_observer_that_never_wrote_saw_nothing(tmp_path: Path):
    assert observed.read(tmp_path / "missing") == ()


@pytest.mark.parametrize("line", ["", "[]", "{}", '{"kind": "other"}', '{"kind": "hop"}', "null"])
def test_lines_that_are_no_observations_are_refused(line: str):
    with pytest.raises(ValueError):  # noqa: PT011 - json's own error is one too
        observed.decode(line)


def test_one_kind_can_be_picked_in_the_order_of_time():
    assert observed.only(Placed, reversed(ALL)) == ALL[:2]


def test_an_announcement_is_read_as_published():
    text = '{"site": "cloud", "phase": "Cloud", "epoch": 2, "reason": "LinkGood", "since_s": 0.9, "silent_ms": null}'
    assert observed.placed(1.0, text) == ALL[0]
    assert observed.placed(1.0, "{}") is None
