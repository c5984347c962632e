"""The folder of recordings: bounded, shared, full, gone."""

import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from mcap.reader import make_reader
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from robot_offload_agent.record.mcap.kept import PART, RESERVE_BYTES, Kept, recordings
from robot_offload_agent.record.mcap.ring import Changeover, Entry, Window


class Usage(NamedTuple):
    total: int
    used: int
    free: int


def window(at_s: int, epoch: int = 3) -> Window:
    stamp_ns = at_s * 1_000_000_000
    data = serialize_message(String(data="hello"))
    said = Entry(float(at_s), stamp_ns, "/chatter", "std_msgs/msg/String", data)
    return Window(Changeover(float(at_s), stamp_ns, "robot", epoch, "HeartbeatLost"), (said,), cut=False)


def kept(folder: Path, keep: int = 3, uid: str = "chair") -> Kept:
    return Kept(folder / "recordings", keep, "1.2.3", uid)


def test_a_recording_is_named_after_its_changeover_and_says_why(tmp_path: Path) -> None:
    file = kept(tmp_path).write(window(1_800_000_000))
    assert file.name == "switch-20270115T080000.000Z-robot-3-chair.mcap"
    assert file.parent.stat().st_mode & 0o077 == 0
    with file.open("rb") as stream:
        reader = make_reader(stream)
        [facts] = [each.metadata for each in reader.iter_metadata()]
        assert (facts["to"], facts["epoch"], facts["reason"], facts["cut"]) == ("robot", "3", "HeartbeatLost", "false")
        assert len(list(reader.iter_messages())) == 1


def test_only_the_newest_are_kept(tmp_path: Path) -> None:
    store = kept(tmp_path)
    files = [store.write(window(1_800_000_000 + number)) for number in range(6)]
    assert list(recordings(store.folder)) == files[-3:]


def test_two_agents_share_a_folder_and_remove_nothing_that_the_other_is_writing(tmp_path: Path) -> None:
    one, other = kept(tmp_path), kept(tmp_path, uid="arm")
    one.write(window(1_800_000_000))
    unfinished = one.folder / f"switch-20270115T080009.000Z-robot-9-chair.mcap{PART}"
    unfinished.write_bytes(b"half")
    other.write(window(1_800_000_000))
    assert unfinished.exists()
    assert len(list(recordings(one.folder))) == 2


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    store = kept(tmp_path)
    store.folder.mkdir()
    unfinished = store.folder / f"switch-20270115T080000.000Z-robot-9-chair.mcap{PART}"
    unfinished.write_bytes(b"half")
    store.write(window(1_800_000_000))
    assert not unfinished.exists()


def test_foreign_files_in_the_folder_are_left_alone(tmp_path: Path) -> None:
    store = kept(tmp_path, keep=1)
    store.folder.mkdir()
    (store.folder / "switch-notes.mcap").touch()
    for number in range(3):
        store.write(window(1_800_000_000 + number))
    assert (store.folder / "switch-notes.mcap").exists()
    assert len(list(recordings(store.folder))) == 1


def test_a_disk_that_is_nearly_full_is_left_its_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1, 1, RESERVE_BYTES))
    with pytest.raises(OSError, match="No space left"):
        kept(tmp_path).write(window(1_800_000_000))
    assert list((tmp_path / "recordings").iterdir()) == []


def test_a_folder_that_is_none_is_an_os_error(tmp_path: Path) -> None:
    (tmp_path / "recordings").write_text("no folder")
    with pytest.raises(OSError, match="exists"):
        kept(tmp_path).write(window(1_800_000_000))


def test_a_type_that_nobody_knows_leaves_no_half_file(tmp_path: Path) -> None:
    unknown = window(1_800_000_000)
    entry = Entry(1.0, 1, "/x", "nobody_msgs/msg/Thing", b"")
    with pytest.raises(Exception, match="nobody_msgs"):
        kept(tmp_path).write(Window(unknown.changeover, (entry,), cut=False))
    assert list((tmp_path / "recordings").iterdir()) == []
