"""The audit trail on the disk: synced, in one chain over restarts and files, and in nobody's way."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from robot_offload_agent.main import main
from robot_offload_agent.record import audit as trails
from robot_offload_agent.record.audit import AuditTrail, files, lines
from robot_offload_core.control.robot import placement
from robot_offload_core.control.robot.placement import Wish
from robot_offload_core.control.robot.process import FROM_CLOUD
from robot_offload_core.fence.token import Site
from robot_offload_core.record import audit
from robot_offload_core.record.audit import Kind, verify
from robot_offload_core.words.events import Machine
from robot_offload_core.words.messages import PulseSent

Opened = Callable[[Path], AuditTrail]


class Epoch:
    epoch = 7


@pytest.fixture
def opened() -> Iterator[Opened]:
    """Opens trails that are closed at the end."""
    with ExitStack() as stack:

        def make(folder: Path) -> AuditTrail:
            trail = AuditTrail(folder)
            stack.callback(trail.close)
            return trail

        yield make


def said(folder: Path, count: int) -> AuditTrail:
    """A process that writes entries and is gone."""
    trail = AuditTrail(folder)
    for number in range(count):
        trail.say(Kind.PIN, "test", number=str(number))
    assert trail.turn()
    trail.close()
    return trail


def test_entries_of_one_process_after_another_are_one_chain(tmp_path: Path) -> None:
    said(tmp_path / "audit", 3)
    last = said(tmp_path / "audit", 4)
    verdict = verify(lines(tmp_path / "audit"))
    assert (verdict.problems, verdict.entries, verdict.last) == ((), 7, last.head)
    assert (tmp_path / "audit").stat().st_mode & 0o077 == 0


def test_the_chain_goes_on_over_files_and_the_oldest_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trails, "FILE_BYTES", 1000)
    monkeypatch.setattr(trails, "FILES", 3)
    for _ in range(4):
        said(tmp_path, 10)
    assert len(files(tmp_path)) == 3
    verdict = verify(lines(tmp_path))
    assert verdict.problems == ()
    assert verdict.last.number == 40
    assert verdict.first > 1


def test_a_torn_end_is_named_and_the_chain_goes_on(tmp_path: Path) -> None:
    said(tmp_path, 3)
    [file] = files(tmp_path)
    os.truncate(file, file.stat().st_size - 30)
    said(tmp_path, 1)
    verdict = verify(lines(tmp_path))
    assert verdict.problems == ()
    assert [entry["kind"] for entry in audit.exported(lines(tmp_path))] == ["Pin", "Pin", "Torn", "Pin"]


def test_a_second_agent_in_the_same_folder_writes_nothing_and_says_so(
    tmp_path: Path, opened: Opened, caplog: pytest.LogCaptureFixture
) -> None:
    one, other = opened(tmp_path), opened(tmp_path)
    one.say(Kind.PIN, "one")
    other.say(Kind.PIN, "other")
    assert one.turn()
    assert not other.turn()
    assert "another agent writes there" in other.problem
    assert "AuditFailed" in caplog.text
    assert [entry["who"] for entry in audit.exported(lines(tmp_path))] == ["one"]


def test_what_a_full_disk_does_not_take_is_written_when_there_is_room(
    tmp_path: Path, opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    said(tmp_path, 1)
    trail = opened(tmp_path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        trail.say(Kind.PIN, "later")
        assert not trail.turn()
        assert "No space left" in trail.problem
    assert trail.turn()
    assert trail.problem == ""
    verdict = verify(lines(tmp_path))
    assert (verdict.problems, verdict.entries) == ((), 2)


def test_a_folder_that_is_none_is_a_problem_and_no_end(tmp_path: Path) -> None:
    (tmp_path / "audit").write_text("no folder")
    trail = AuditTrail(tmp_path / "audit")
    trail.say(Kind.PIN, "x")
    assert not trail.turn()
    assert trail.problem


def test_entries_that_find_no_room_are_counted_and_named(
    tmp_path: Path, opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trails, "WAITING", 5)
    trail = opened(tmp_path)
    for _ in range(8):
        trail.say(Kind.PIN, "x")
    assert trail.turn()
    assert trail.missed == 3
    assert audit.exported(lines(tmp_path))[-1]["what"] == {"entries": "3"}


def test_garbage_in_the_file_does_not_keep_the_agent_from_writing(tmp_path: Path) -> None:
    (tmp_path / "audit-00000001.log").write_bytes(b"\xff\x00garbage\n" * 50)
    said(tmp_path, 2)
    verdict = verify(lines(tmp_path))
    assert verdict.entries == 2
    assert verdict.problems


def test_switches_by_hand_and_overrides_are_seen_with_where_they_came_from(tmp_path: Path, opened: Opened) -> None:
    trail = opened(tmp_path)
    for event in (
        placement.SwitchByHand(Site.CLOUD, 4), placement.SwitchByHand(Site.ROBOT, FROM_CLOUD),
        placement.SetPin(Wish(Site.ROBOT, 160.0)), placement.SetPin(None), PulseSent(1, 1),
    ):  # fmt: skip
        trail.stepped(Machine.PLACEMENT, 100.0, event, Epoch(), ())
    assert trail.turn()
    found = [(entry["kind"], entry["who"], entry["what"]) for entry in audit.exported(lines(tmp_path))]
    override = "parameter `override` on the robot"
    assert found == [
        ("SwitchByHand", "service on the robot", {"to": "cloud", "epoch": "7"}),
        ("SwitchByHand", "service in the cloud", {"to": "robot", "epoch": "7"}),
        ("Override", override, {"to": "robot", "for_s": "60"}),
        ("Override", override, {"to": "Auto", "for_s": ""}),
    ]


def parameters(folder: Path) -> Path:
    file = folder / "agent.yaml"
    file.write_text(f"/**:\n  ros__parameters: {{side: robot, uid: chair, state_dir: {folder}}}\n")
    return file


def test_the_command_checks_prints_and_compares_a_head(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trail = said(tmp_path / "audit", 3)
    words = ["--params", str(parameters(tmp_path))]
    assert main(["audit", "verify", *words, "--head", str(trail.head)]) == 0
    assert str(trail.head) in capsys.readouterr().out
    assert main(["audit", "export", *words]) == 0
    assert len(json.loads(capsys.readouterr().out)) == 3
    [file] = files(tmp_path / "audit")
    file.write_text(file.read_text().replace('"number":"1"', '"number":"9"'))
    assert main(["audit", "verify", *words]) == 1
    assert "NOT AS WRITTEN" in capsys.readouterr().out
