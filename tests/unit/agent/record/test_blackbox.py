"""The black box on the disk: bounded, in nobody's way, and readable whatever ended it."""

from pathlib import Path
from typing import Any

import pytest

from robot_offload_agent.record import blackbox as boxes
from robot_offload_agent.record.blackbox import PARTS, WAITING, BlackBox, digest_of_core, parts
from robot_offload_core.control.nodes import guardians
from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Differs, Gap, Header, Replayed
from robot_offload_core.words.events import Machine, Tick

START = guardians.start((), 1.0)


class Steps:
    """A guardian without nodes whose time passes."""

    def __init__(self, box: BlackBox) -> None:
        self.box, self.now_s, self.state = box, 0.0, START
        box.restated(Machine.GUARDIAN, self.now_s, self.state)

    def take(self, count: int) -> None:
        for _ in range(count):
            self.now_s += 0.02
            self.state, commands = guardians.step(self.state, Tick(), self.now_s)
            self.box.stepped(Machine.GUARDIAN, self.now_s, Tick(), self.state, commands)


def box_in(folder: Path, total_bytes: int = 1 << 20, process: str = "one") -> BlackBox:
    return BlackBox(folder, total_bytes, {"process": process})


def drained(box: BlackBox) -> None:
    while box._waiting and not box.ended:
        box.turn()


def found_in(folder: Path) -> list[Any]:
    return list(blackbox.replay(line for file in parts(folder) for line in file.read_text().splitlines()))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "blackbox"


def test_every_step_of_a_process_is_replayed_from_the_disk(folder: Path) -> None:
    box = box_in(folder)
    Steps(box).take(500)
    drained(box)
    found = found_in(folder)
    assert sum(isinstance(one, Replayed) for one in found) == 500
    assert not any(isinstance(one, Differs | Gap) for one in found)
    assert folder.stat().st_mode & 0o077 == 0


def test_the_ring_never_grows_beyond_its_size_and_keeps_the_newest(folder: Path) -> None:
    box = box_in(folder, total_bytes=400_000)
    steps = Steps(box)
    for _ in range(100):
        steps.take(100)
        drained(box)
        assert sum(file.stat().st_size for file in parts(folder)) <= 400_000
    assert len(parts(folder)) == PARTS
    replayed = [one for one in found_in(folder) if isinstance(one, Replayed)]
    assert replayed[-1].now_s == steps.now_s
    assert not any(isinstance(one, Differs) for one in found_in(folder))


def test_a_restarted_process_goes_on_with_the_next_file(folder: Path) -> None:
    for process in ("one", "two"):
        box = box_in(folder, process=process)
        Steps(box).take(10)
        drained(box)
    found = found_in(folder)
    assert [one.facts["process"] for one in found if isinstance(one, Header)] == ["one", "two"]
    assert sum(isinstance(one, Replayed) for one in found) == 20
    assert not any(isinstance(one, Differs) for one in found)


def test_what_a_slow_disk_leaves_out_is_counted_and_the_replay_goes_on_behind_it(folder: Path) -> None:
    box = box_in(folder)
    steps = Steps(box)
    steps.take(WAITING + 100)
    drained(box)
    steps.take(50)
    drained(box)
    found = found_in(folder)
    gaps = [one for one in found if isinstance(one, Gap)]
    assert [gap.steps for gap in gaps] == [101]
    assert box.left_out == 101
    replayed = [one for one in found if isinstance(one, Replayed)]
    assert replayed[-1].now_s == steps.now_s
    assert not any(isinstance(one, Differs) for one in found)


def test_a_turn_writes_no_more_than_the_rate_allows(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boxes, "RATE_BYTES", 10_000)
    box = box_in(folder)
    Steps(box).take(1000)
    box.turn()
    assert sum(file.stat().st_size for file in parts(folder)) < 3_000


def test_a_disk_that_cannot_be_written_ends_the_box_and_nothing_else(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder.write_text("no folder")
    box = box_in(folder)
    steps = Steps(box)
    steps.take(10)
    drained(box)
    assert box.ended
    assert "BlackBoxEnded" in caplog.text
    steps.take(10)


def test_a_process_that_ends_has_its_last_steps_written_and_the_one_that_broke_a_rule(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(boxes, "LAST_S", 60.0)
    box = box_in(folder)
    steps = Steps(box)
    box.start()
    steps.take(7)
    box.broke(Machine.GUARDIAN, steps.now_s + 0.02, Tick(), "what must never be")
    box.finish()
    found = found_in(folder)
    assert sum(isinstance(one, Replayed) for one in found) == 8
    assert [one.written for one in found if isinstance(one, Differs)] == [("what must never be",)]


def test_a_process_ends_whether_or_not_its_last_steps_can_be_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(boxes, "LAST_S", 0.01)
    box = box_in(folder)
    Steps(box).take(1)
    box.finish()  # nobody writes
    assert not folder.exists()


def test_the_code_of_the_core_has_a_name() -> None:
    assert digest_of_core() == digest_of_core()
    assert len(digest_of_core()) == 16
