"""Writing a bundle: whose the folder is, which old files go, who may read the key."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

import pytest

from robot_offload.cli.bundle.folder import MARK, Mark, read_mark, write
from robot_offload.errors import InputError

FILES = {"agent.yaml": b"a: 1\n", "certificates/robot.key": b"secret", "certificates/robot.pem": b"public"}
KEY = "certificates/robot.key"


def mark(uid: str = "6b1f", name: str = "w", files: tuple[str, ...] = tuple(FILES)) -> Mark:
    return Mark("ward", name, uid, 3, files)


def put(folder: Path, files: dict[str, bytes] | None = None, *, uid: str = "6b1f", force: bool = False) -> None:
    chosen = FILES if files is None else files
    write(folder, chosen, (KEY,), mark(uid, files=tuple(chosen)), force=force)


def mode(file: Path) -> int:
    return stat.S_IMODE(file.stat().st_mode)


def test_a_new_folder_holds_the_files_and_the_mark(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "w"
    put(folder)
    assert {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()} == {*FILES, MARK}
    assert (folder / "agent.yaml").read_bytes() == b"a: 1\n"
    assert read_mark((folder / MARK).read_text()) == mark()


def test_only_the_owner_may_read_the_key(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        put(tmp_path / "w")
        (tmp_path / "w" / KEY).chmod(0o666)  # a hand that meant well
        put(tmp_path / "w")
    finally:
        os.umask(before)
    assert mode(tmp_path / "w" / KEY) == 0o600
    assert mode(tmp_path / "w" / "agent.yaml") == 0o644


def test_a_newer_bundle_replaces_the_older_one_and_its_left_over_files(tmp_path: Path) -> None:
    put(tmp_path / "w", {**FILES, "ddsrouter.yaml": b"old"})
    (tmp_path / "w" / "notes.txt").write_text("mine")
    put(tmp_path / "w", {**FILES, "agent.yaml": b"a: 2\n"})
    assert not (tmp_path / "w" / "ddsrouter.yaml").exists()
    assert (tmp_path / "w" / "agent.yaml").read_bytes() == b"a: 2\n"
    assert (tmp_path / "w" / "notes.txt").read_text() == "mine"


def test_a_foreign_folder_is_not_touched_without_force(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("chapter 1")
    with pytest.raises(InputError, match=r"holds other files \(thesis\.tex\).*--force"):
        put(tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]
    put(tmp_path, force=True)
    assert (tmp_path / "thesis.tex").read_text() == "chapter 1"
    assert (tmp_path / KEY).exists()


def test_the_bundle_of_another_robot_is_not_overwritten(tmp_path: Path) -> None:
    put(tmp_path / "w", uid="other")
    with pytest.raises(InputError, match="is the bundle of ward/w of another cluster or an earlier life"):
        put(tmp_path / "w")
    put(tmp_path / "w", force=True)
    found = read_mark((tmp_path / "w" / MARK).read_text())
    assert found is not None
    assert found.uid == "6b1f"


def test_a_mark_cannot_make_us_delete_outside_the_folder(tmp_path: Path) -> None:
    (tmp_path / "victim").write_text("alive")
    put(tmp_path / "w")
    values = json.loads((tmp_path / "w" / MARK).read_text())
    values["files"] += ["../victim", str(tmp_path / "victim")]
    (tmp_path / "w" / MARK).write_text(json.dumps(values))
    put(tmp_path / "w")
    assert (tmp_path / "victim").read_text() == "alive"


def test_a_link_in_place_of_a_file_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_text("alive")
    put(tmp_path / "w")
    (tmp_path / "w" / KEY).unlink()
    (tmp_path / "w" / KEY).symlink_to(tmp_path / "elsewhere")
    put(tmp_path / "w")
    assert (tmp_path / "elsewhere").read_text() == "alive"
    assert not (tmp_path / "w" / KEY).is_symlink()


def test_a_file_in_place_of_the_folder_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "w").write_text("")
    with pytest.raises(InputError, match="is a file; name a folder"):
        put(tmp_path / "w")
    with pytest.raises(InputError, match="cannot be written"):
        put(tmp_path / "w" / "below")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"name": "w"}', '{"generation": "x"}'])
def test_what_is_no_mark_is_none(text: str) -> None:
    assert read_mark(text) is None
