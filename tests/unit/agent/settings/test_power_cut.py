"""What a loss of power leaves of the files that outlive it: a real file system whose disk is copied at the moment.

What the kernel has not written to the disk by then is not in the copy, as it would not be on the disk.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robot_offload_agent.settings import override as overrides
from robot_offload_agent.settings.files import write_whole
from robot_offload_agent.settings.override import Override
from robot_offload_agent.settings.parameters import Configuration, parse

DISK_BYTES = 16 << 20
SELDOM = "loop,commit=300"
"""The file system's own commits come too late to save anything."""


class Disk:
    """A small ext4 file system on `folder`."""

    def __init__(self, place: Path) -> None:
        self.image, self.folder, self.copies = place / "disk.img", place / "disk", place / "copies"
        self.copies.mkdir()

    def cut(self) -> Path:
        """Returns the disk as it would be if the power went now."""
        return Path(shutil.copy(self.image, self.copies / f"{len(list(self.copies.iterdir()))}.img"))


@contextmanager
def mounted(image: Path, folder: Path, options: str = SELDOM) -> Iterator[Path]:
    folder.mkdir(exist_ok=True)
    subprocess.run(["mount", "-o", options, str(image), str(folder)], check=True, capture_output=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    disk = Disk(tmp_path)
    disk.image.write_bytes(b"")
    os.truncate(disk.image, DISK_BYTES)
    try:
        subprocess.run(["mkfs.ext4", "-q", str(disk.image)], check=True, capture_output=True)
        mount = mounted(disk.image, disk.folder)
        mount.__enter__()
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no file system can be mounted here: {error}")
    try:
        yield disk
    finally:
        mount.__exit__(None, None, None)


def configuration(disk: Disk) -> Configuration:
    return parse({"side": "robot", "uid": "walker-1", "state_dir": str(disk.folder / "state")})


def after(image: Path, disk: Disk) -> str:
    """Returns the override that an agent finds after the power came back."""
    with mounted(image, disk.folder.with_name("later"), "loop") as folder:
        return Override(parse({"side": "robot", "uid": "walker-1", "state_dir": str(folder / "state")})).word


def test_what_was_not_written_for_good_is_lost_with_the_power(disk: Disk) -> None:
    path = overrides.state_dir(configuration(disk)) / "override.json"
    found: list[str] = []
    while "Robot" not in found and len(found) < 10:  # whoever calls sync on this machine saves it
        Override(configuration(disk)).set("Robot", 0.0)
        write_whole(path, path.read_text().replace("Robot", "Cloud"))
        found.append(after(disk.cut(), disk))
    assert found[-1] == "Robot", found


def test_an_override_that_was_set_outlives_a_loss_of_power(disk: Disk) -> None:
    for word in ("Robot", "Cloud", "Auto"):
        Override(configuration(disk)).set(word, 0.0)
        assert after(disk.cut(), disk) == word


def test_whenever_the_power_goes_the_old_override_is_there_or_the_new_one(
    disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    override = Override(configuration(disk))
    override.set("Robot", 0.0)
    cuts: list[Path] = []

    def cut_around(step: Callable[..., object]) -> Callable[..., object]:
        def stepped(*words: object) -> object:
            cuts.append(disk.cut())
            done = step(*words)
            cuts.append(disk.cut())
            return done

        return stepped

    monkeypatch.setattr(os, "fsync", cut_around(os.fsync))
    monkeypatch.setattr(Path, "replace", cut_around(Path.replace))
    override.set("Cloud", 0.0)
    monkeypatch.undo()
    found = [after(image, disk) for image in cuts]
    assert len(found) == 6
    assert set(found) == {"Robot", "Cloud"}
    assert found[0] == "Robot"
    assert found[-1] == "Cloud"
