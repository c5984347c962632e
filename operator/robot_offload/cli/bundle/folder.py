"""Write a bundle into a folder: whose the folder is, which old files go, and who may read the key."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from robot_offload.errors import InputError

MARK: Final = "bundle.json"
"""The file that marks a folder as a bundle and names its owner."""
PRIVATE: Final = 0o600
PUBLIC: Final = 0o644


@dataclass(frozen=True, slots=True)
class Mark:
    """The content of a bundle's mark.

    Attributes:
        namespace: of the RobotOffload.
        name: of the RobotOffload.
        uid: of the RobotOffload.
        generation: of the specification from which the bundle was made.
        files: the bundle's files, without the mark.
    """

    namespace: str
    name: str
    uid: str
    generation: int
    files: tuple[str, ...]

    def text(self) -> str:
        """Return the mark as it is written."""
        values = {
            "namespace": self.namespace,
            "name": self.name,
            "uid": self.uid,
            "generation": self.generation,
            "files": list(self.files),
        }
        return json.dumps(values, indent=2) + "\n"


def read_mark(text: str) -> Mark | None:
    """Parse a mark; return None if the text is not one."""
    try:
        values: Any = json.loads(text)
        return Mark(
            str(values["namespace"]),
            str(values["name"]),
            str(values["uid"]),
            int(values["generation"]),
            tuple(name for name in values["files"] if isinstance(name, str) and _inside(name)),
        )
    except (ValueError, KeyError, TypeError):
        return None


def refusal(folder: Path, entries: Iterable[str], present: Mark | None, wanted: Mark) -> str:
    """Return why a folder must not be written into; empty if it may be.

    Args:
        folder: target.
        entries: the names in it; none: it is empty or does not exist.
        present: its mark; None: it has no mark.
        wanted: the mark of the new bundle.
    """
    names = sorted(entries)
    if not names:
        return ""
    if present is None:
        return (
            f"{folder}: holds other files ({', '.join(names[:3])}); name an empty folder, or write there with --force"
        )
    if present.uid != wanted.uid:
        whose = f"{present.namespace}/{present.name}"
        again = " of another cluster or an earlier life" if whose == f"{wanted.namespace}/{wanted.name}" else ""
        return f"{folder}: is the bundle of {whose}{again}; name another folder, or overwrite it with --force"
    return ""


def write(folder: Path, files: Mapping[str, bytes], private: Iterable[str], mark: Mark, *, force: bool) -> None:
    """Write a bundle. Each file is complete or absent at any moment; the mark is written last.

    Args:
        folder: target; created if needed.
        files: contents by path in the folder.
        private: paths that only the owner may read.
        mark: of the bundle.
        force: write even into a foreign folder. Files that do not come from a bundle stay.

    Raises:
        InputError: the folder belongs to another bundle or program, or cannot be written.
    """
    try:
        _write(folder, files, frozenset(private), mark, force=force)
    except OSError as error:
        raise InputError(f"{error.filename or folder}: cannot be written: {error.strerror}") from error


def _write(folder: Path, files: Mapping[str, bytes], private: frozenset[str], mark: Mark, *, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder")
    entries = [entry.name for entry in folder.iterdir()] if folder.exists() else []
    present = read_mark((folder / MARK).read_text(encoding="utf-8", errors="replace")) if MARK in entries else None
    problem = refusal(folder, entries, present, mark)
    if problem and not force:
        raise InputError(problem)
    for name in sorted(set(present.files if present else ()) - set(files)):
        (folder / name).unlink(missing_ok=True)
    for name, content in files.items():
        _replace(folder / name, content, PRIVATE if name in private else PUBLIC)
    _replace(folder / MARK, mark.text().encode(), PUBLIC)


def _replace(file: Path, content: bytes, mode: int) -> None:
    """Write a file with its final mode from the first byte on, then put it into place atomically."""
    file.parent.mkdir(parents=True, exist_ok=True)
    new = file.with_name(f".{file.name}.new")
    new.unlink(missing_ok=True)
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, mode)
    with os.fdopen(descriptor, "wb") as opened:
        os.fchmod(opened.fileno(), mode)
        opened.write(content)
    new.replace(file)


def _inside(name: str) -> bool:
    """Return whether a path stays in its folder: the mark may have been edited by hand."""
    path = Path(name)
    return not path.is_absolute() and ".." not in path.parts and name != MARK
