"""Archives of images: the newest complete one, and what is forgotten."""

from __future__ import annotations

import json
import os
import tarfile
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from tests.e2e import images


def layout(folder: Path, layers: dict[str, bytes]) -> dict[str, Path]:
    """Blobs as a builder leaves them."""
    blobs = folder / "blobs" / "sha256"
    blobs.mkdir(parents=True)
    for name, content in layers.items():
        (blobs / name).write_bytes(content)
    return {name: blobs / name for name in layers}


def test_an_archive_is_whole_and_tells_what_it_holds(tmp_path: Path) -> None:
    blobs = layout(tmp_path / "layout", {"aa": b"one", "bb": b"two"})
    images._write(tmp_path / "k1-complete.tar", {"manifests": []}, blobs)
    found, held = images._newest_complete(tmp_path)
    assert (found, held) == (tmp_path / "k1-complete.tar", frozenset({"aa", "bb"}))
    with tarfile.open(tmp_path / "k1-complete.tar") as archive:
        assert {"oci-layout", "index.json"} <= set(archive.getnames())


def test_without_archives_there_is_nothing_to_build_upon(tmp_path: Path) -> None:
    assert images._newest_complete(tmp_path) == (None, frozenset())


def test_what_old_sources_needed_is_forgotten_but_not_what_a_kept_one_stands_on(tmp_path: Path) -> None:
    for number in range(10):
        key = f"k{number}"
        names = ["base-complete.tar", f"{key}.tar"]
        for name in names:
            (tmp_path / name).touch()
        (tmp_path / f"{key}.json").write_text(json.dumps(names))
        os.utime(tmp_path / f"{key}.json", (number, number))
    images._forget_old(tmp_path, keep=["k9.tar"])
    left = {path.name for path in tmp_path.glob("*.tar")}
    assert left == {"base-complete.tar", *(f"k{number}.tar" for number in range(2, 10))}


def test_images_of_before_are_taken_when_they_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "abc.json").write_text("[]")
    monkeypatch.setenv(images.CHOSEN, "newest")
    assert images._chosen(tmp_path) == "abc"
    monkeypatch.setenv(images.CHOSEN, "abd")
    with pytest.raises(InputError, match="no images of that key"):
        images._chosen(tmp_path)
