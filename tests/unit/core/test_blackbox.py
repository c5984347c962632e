"""The black box: what it keeps leads the same core to the same decisions, and says so when it does not."""

from dataclasses import dataclass

import pytest

from robot_offload_core import blackbox
from robot_offload_core.blackbox import Differs, Gap, Replayed
from robot_offload_core.events import Machine
from robot_offload_core.placement import Decided
from robot_offload_lab.simulate.boxes import Boxes, MemoryBox
from robot_offload_lab.simulate.chunk import BOXED, Chunk
from robot_offload_lab.simulate.faults import only_link
from robot_offload_lab.simulate.goal_storm import drawn, with_goals


@dataclass(frozen=True)
class Storm:
    boxes: list[MemoryBox]
    steps: int


@pytest.fixture(scope="module")
def storm() -> Storm:
    chunk = Chunk(5, BOXED - 1, drawn)
    outcome = chunk.live()
    assert not outcome.violation
    return Storm(chunk.boxes.boxes, chunk.boxes.judge(60.0))


@pytest.fixture(scope="module")
def lines(storm: Storm) -> list[str]:
    """The longest box of a robot."""
    return max((box.text() for box in storm.boxes if "placement" in box.text()[1] + box.text()[2]), key=len)


def test_a_storm_on_both_sides_is_replayed_step_by_step(storm: Storm) -> None:
    assert storm.steps > 10_000
    found = [found for box in storm.boxes for found in blackbox.replay(box.text())]
    kinds = {step.machine for step in found if isinstance(step, Replayed)}
    assert kinds == set(Machine)


def test_each_decision_is_shown_with_the_states_around_it(lines: list[str]) -> None:
    steps = [f for f in blackbox.replay(lines) if isinstance(f, Replayed) and f.machine is Machine.PLACEMENT]
    decisions = [(step, decision) for step in steps for decision in step.decided]
    assert decisions
    assert all(isinstance(decision, Decided) and step.after.decided == decision.verdict for step, decision in decisions)


def test_another_decision_than_the_written_one_is_named(lines: list[str]) -> None:
    at = next(i for i, text in enumerate(lines) if '["did","placement"' in text)
    others = [*lines[:at], *lines[at + 1 :]]
    found = [f for f in blackbox.replay(others) if isinstance(f, Differs)]
    assert len(found) == 1
    assert (found[0].written, len(found[0].replayed)) == ((), 1)


@pytest.mark.parametrize("harm", ["torn", "altered", "garbage", "unknown"])
def test_a_line_that_cannot_be_read_is_a_gap_and_the_next_key_frame_goes_on(lines: list[str], harm: str) -> None:
    at = len(lines) // 3
    text = lines[at]
    bad = {
        "torn": text[: len(text) // 2],
        "altered": text.replace("1", "2", 1) if "1" in text[9:] else text + "1",
        "garbage": "\x00\xff{",
        "unknown": blackbox.line(["step", "placement", 1.0, "NobodyKnowsThis", []]).rstrip("\n"),
    }[harm]
    found = list(blackbox.replay([*lines[:at], bad, *lines[at + 1 :]]))
    assert sum(isinstance(f, Gap) for f in found) == 1
    assert not any(isinstance(f, Differs) for f in found)
    after = [f for f in found[found.index(Gap(0)) :] if isinstance(f, Replayed)]
    assert len(after) > len(lines) // 4


def test_a_box_that_ends_in_the_middle_of_a_line_is_replayed_up_to_there(lines: list[str]) -> None:
    text = "\n".join(lines[: len(lines) // 2])
    found = list(blackbox.replay(text[:-7].splitlines()))
    assert isinstance(found[-1], Gap)
    assert sum(isinstance(f, Replayed) for f in found) > len(lines) // 8


def test_another_process_begins_with_states_of_its_own(storm: Storm) -> None:
    both = [line for box in storm.boxes[:4] for line in box.text()]
    assert not any(isinstance(f, Differs | Gap) for f in blackbox.replay(both))


def test_nothing_is_kept_of_a_stretch_without_boxes() -> None:
    assert Boxes().judge(0.0) == 0


def test_boxes_come_to_stretches_of_all_kinds_of_a_campaign() -> None:
    boxed = range(BOXED - 1, 60 * BOXED, BOXED)
    kinds = {(only_link(index), with_goals(index)) for index in range(60)}
    assert {(only_link(index), with_goals(index)) for index in boxed} == kinds
