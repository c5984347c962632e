"""`robot-offload blackbox`: a stretch of the simulation with its boxes on the disk, replayed, cut, made a test."""

import json
import re
import runpy
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from robot_offload.cli.main import app
from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.placement import Robot
from robot_offload_core.record import blackbox
from robot_offload_core.words.checks import require
from robot_offload_core.words.events import Machine
from robot_offload_lab.blackbox import ring
from robot_offload_sim.chunk import BOXED, Chunk
from robot_offload_sim.world.boxes import MemoryBox

BEGAN_S = time.mktime((2026, 11, 22, 14, 0, 0, 0, 0, -1))


@pytest.fixture(scope="module")
def box() -> MemoryBox:
    """The robot's longest box of a stretch that began at 14:00."""
    chunk = Chunk(14, BOXED - 1)
    assert not chunk.live().violation
    robots = [box for box in chunk.boxes.boxes if any('"placement"' in line for line in box.text()[:3])]
    return max(robots, key=lambda box: len(box.lines))


@pytest.fixture
def folder(box: MemoryBox, tmp_path: Path) -> Path:
    """A ring of three files."""
    first = blackbox.parse(box.text()[1])
    assert isinstance(first, blackbox.KeyFrame)
    facts = {"process": "one", "side": "robot", "to_wall_s": BEGAN_S - first.now_s, "core": ring.digest_of_core()}
    body = box.text()[1:]
    third = len(body) // 3
    for number in range(3):
        end = None if number == 2 else third * (number + 1)
        text = blackbox.header(facts) + "".join(f"{line}\n" for line in body[third * number : end])
        (tmp_path / f"box-{number + 1:08d}.log").write_text(text)
    return tmp_path


def run(*words: object) -> Result:
    return CliRunner().invoke(app, ["blackbox", *map(str, words)])


def test_a_ring_is_replayed_with_each_decision_at_its_time_of_day(folder: Path) -> None:
    done = run("replay", folder)
    assert done.exit_code == 0, done.output
    assert re.search(r"^14:0\d:\d\d\.\d{3}  placement", done.stdout, re.MULTILINE)
    assert "all as written" in done.stdout.splitlines()[-1]


def test_states_show_what_a_step_changed(folder: Path) -> None:
    assert re.search(r"^ +phase: \w+ -> \w+$", run("replay", folder, "--states").stdout, re.MULTILINE)


def test_json_has_the_same_moments(folder: Path) -> None:
    found = json.loads(run("replay", folder, "--json").stdout)
    assert found["differences"] == 0
    assert found["steps"] > 1000
    assert len(found["moments"]) == found["decisions"] > 0


def test_what_the_core_decides_otherwise_is_an_error_that_names_both(folder: Path) -> None:
    file = folder / "box-00000002.log"
    lines = file.read_text().splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if '["did"' in line)
    lines[at] = ""
    file.write_text("".join(lines))
    done = run("replay", folder)
    assert done.exit_code == 1
    assert "DIFFERS from what was written: nothing" in done.stdout


def test_another_core_is_said(folder: Path) -> None:
    file = folder / "box-00000001.log"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text(blackbox.header({"process": "one", "core": "0123456789abcdef"}) + "".join(lines[1:]))
    assert "written by another core (0123456789abcdef; this one is" in run("replay", folder).stdout


def test_a_cut_is_small_and_replays_as_it_is(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "switch.box"
    done = run("cut", folder, "--around", "14:00:40", "--before", "3", "--after", "2", "-o", out)
    assert done.exit_code == 0, done.output
    assert out.stat().st_size < sum(file.stat().st_size for file in folder.glob("box-*.log")) / 2
    again = run("replay", out)
    assert again.exit_code == 0
    assert "all as written" in again.stdout


def test_a_cut_becomes_a_test_that_expects_what_was_decided(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "test_story.py"
    done = run("to-test", folder, "--name", "a_storm", "-o", out)
    assert done.exit_code == 0, done.output
    assert passes(out)
    text = out.read_text()
    changed = re.sub(r"placement: (\w+) epoch", r"placement: neither epoch", text, count=1)
    assert changed != text
    out.write_text(changed)
    assert not passes(out)


def test_a_decision_that_was_wrong_becomes_a_test_that_fails_until_the_core_decides_otherwise(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moments = json.loads(run("replay", folder, "--json").stdout)["moments"]
    wrong = next(one for one in moments if one["name"] == "Decided")
    out = tmp_path / "test_leaves_too_early.py"
    done = run("to-test", folder, "--name", "leaves_too_early", "--wrong", ring.clock(wrong["wall_s"]), "-o", out)
    assert done.exit_code == 0, done.output
    assert not passes(out)
    kind = blackbox.KINDS[Machine.PLACEMENT]
    decides_nothing = replace(kind, step=lambda *taken: (kind.step(*taken)[0], []))
    monkeypatch.setitem(blackbox.KINDS, Machine.PLACEMENT, decides_nothing)
    run_here(out, "test_leaves_too_early")


def test_a_broken_rule_becomes_a_test_that_fails_until_the_core_is_mended(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = switcher.check

    def checked(before: Robot, after: Robot, event: object) -> None:
        check(before, after, event)  # type: ignore[arg-type]
        require("switcher", event, (after.epoch < 3, "no third epoch"))

    out = tmp_path / "test_third_epoch.py"
    with monkeypatch.context() as patch:
        patch.setattr(switcher, "check", checked)
        done = run("to-test", folder, "--name", "third_epoch", "-o", out)
        assert "fails while a step breaks a rule" in done.stdout
        with pytest.raises(AssertionError):
            run_here(out, "test_third_epoch")
    run_here(out, "test_third_epoch")
    assert passes(out)


def test_a_made_test_fails_where_the_core_cannot_read_its_box_any_more(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "test_story.py"
    assert run("to-test", folder, "--name", "a_storm", "-o", out).exit_code == 0
    kind = blackbox.KINDS[Machine.PLACEMENT]
    monkeypatch.setitem(blackbox.KINDS, Machine.PLACEMENT, replace(kind, events={}))
    with pytest.raises(AssertionError, match="cannot read the box"):
        run_here(out, "test_a_storm")


def run_here(module: Path, name: str) -> None:
    """Runs a made test in this process, whose core a test may have changed."""
    runpy.run_path(str(module))[name]()


def passes(module: Path) -> bool:
    options = ["-q", "-p", "no:cacheprovider", "--rootdir", str(module.parent)]
    command = [sys.executable, "-m", "pytest", *options, str(module)]
    return subprocess.run(command, cwd=module.parent, capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("replay", "nowhere.log"), "nowhere.log: No such file"),
        (("replay", "FOLDER", "--around", "noon"), "write a time of day"),
        (("replay", "FOLDER", "--around", "03:00:00"), "the box has nothing of that time; its newest step is of 14:0"),
        (("to-test", "FOLDER", "--name", "A-b", "-o", "x"), "write an identifier"),
        (("to-test", "FOLDER", "--name", "a", "--wrong", "03:00:00.000", "-o", "x"), "nothing was decided then"),
    ],
)
def test_bad_words_are_answered_with_the_next_step(folder: Path, words: tuple[str, ...], message: str) -> None:
    done = run(*(str(folder) if word == "FOLDER" else word for word in words))
    assert done.exit_code != 0
    assert message in str(done.exception) + done.output


def test_a_folder_without_a_box_is_said_to_be_none(tmp_path: Path) -> None:
    done = run("replay", tmp_path)
    assert "is not a black box" in str(done.exception) + done.output
