"""The black box: what it keeps leads the same core to the same decisions, and says so when it does not."""

from dataclasses import dataclass

import pytest

from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.placement import Robot
from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Differs, Gap, KeyFrame, Replayed, RuleBroken, Step
from robot_offload_core.words.checks import require
from robot_offload_core.words.decided import Decided
from robot_offload_core.words.events import Machine
from robot_offload_sim.chunk import BOXED, BOXED_SHARE, CHUNK_S, Chunk, boxed_s
from robot_offload_sim.faults.faults import only_link
from robot_offload_sim.stories.goal_storm import drawn, with_goals
from robot_offload_sim.world.boxes import WHOLE, Boxes, MemoryBox
from robot_offload_sim.world.violations import ViolationError


@dataclass(frozen=True)
class Storm:
    boxes: list[MemoryBox]
    steps: int


@pytest.fixture(scope="module")
def storm() -> Storm:
    chunk = Chunk(5, BOXED - 1, drawn)
    assert chunk.boxes.window_s == WHOLE
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


def test_nothing_is_kept_while_no_process_runs() -> None:
    assert Boxes(lambda: 0.0).judge(0.0) == 0


def test_whole_boxes_come_to_stretches_of_all_kinds_of_a_campaign() -> None:
    boxed = range(BOXED - 1, 60 * BOXED, BOXED)
    kinds = {(only_link(index), with_goals(index)) for index in range(60)}
    assert {(only_link(index), with_goals(index)) for index in boxed} == kinds


def test_every_other_stretch_is_replayed_in_a_part_that_chance_chooses() -> None:
    parts = [boxed_s(5, index) for index in range(BOXED - 1)]
    assert {round(to_s - from_s, 6) for from_s, to_s in parts} == {BOXED_SHARE * CHUNK_S}
    assert all(from_s >= 0 and to_s <= CHUNK_S for from_s, to_s in parts)
    assert len({from_s for from_s, _ in parts}) == len(parts)


@pytest.fixture(scope="module")
def part() -> Chunk:
    """A stretch of which a part is kept."""
    chunk = Chunk(5, 3)
    outcome = chunk.live()
    assert not outcome.violation
    assert outcome.replayed > 500
    return chunk


def test_a_part_of_a_stretch_is_replayed_from_its_first_state_to_the_state_after_its_last_step(part: Chunk) -> None:
    lengths_s = []
    for box in part.boxes.boxes:
        records = [record for line in box.text() if isinstance(record := blackbox.parse(line), KeyFrame | Step)]
        for machine in {record.machine for record in records}:
            own = [record for record in records if record.machine is machine]
            assert isinstance(own[0], KeyFrame)
            lengths_s += [own[-1].now_s - own[0].now_s] if isinstance(own[-1], KeyFrame) else []
    assert max(lengths_s) == pytest.approx(BOXED_SHARE * CHUNK_S, abs=1.0)


def test_a_decision_that_does_not_follow_is_a_violation(part: Chunk) -> None:
    places = [(box, i) for box in part.boxes.boxes for i, line in enumerate(box.lines) if '["did"' in line]
    box, at = places[len(places) // 2]
    taken = box.lines[at]
    box.lines[at] = taken.splitlines(keepends=True)[0]
    try:
        with pytest.raises(ViolationError, match="a black box leads to other decisions"):
            part.boxes.judge(60.0)
    finally:
        box.lines[at] = taken


RULE = "the test wants no third epoch"


@pytest.fixture(scope="module")
def broken() -> list[str]:
    """The box of a robot whose core has a rule that a changeover breaks."""
    check = switcher.check

    def checked(before: Robot, after: Robot, event: object) -> None:
        check(before, after, event)  # type: ignore[arg-type]
        require("switcher", event, (after.epoch < 3, RULE))

    chunk = Chunk(5, BOXED - 1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(switcher, "check", checked)
        assert RULE in chunk.live().violation
        box = next(box for box in chunk.boxes.boxes if '["broke"' in box.lines[-1])
        found = list(blackbox.replay(box.text()))
    assert [one.rule for one in found if isinstance(one, RuleBroken)] == [RULE]
    assert not any(isinstance(one, Differs) for one in found)
    return box.text()


def test_the_step_that_broke_a_rule_is_kept_and_a_mended_core_is_said_to_differ(broken: list[str]) -> None:
    found = list(blackbox.replay(broken))
    assert not any(isinstance(one, RuleBroken) for one in found)
    [differs] = [one for one in found if isinstance(one, Differs)]
    assert (differs.written, differs.replayed) == ((RULE,), ())


def test_a_rule_that_only_this_core_breaks_is_named_and_the_next_key_frame_goes_on(
    lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("never")

    monkeypatch.setattr(switcher, "check", never)
    found = list(blackbox.replay(lines))
    assert {one.rule for one in found if isinstance(one, RuleBroken)} == {"never"}
    assert next(one.replayed for one in found if isinstance(one, Differs)) == ("never",)
    assert any(isinstance(one, Replayed) and one.machine is Machine.GUARDIAN for one in found)
