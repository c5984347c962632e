"""Files that commands write for a person to edit: one that is there already is not replaced unasked."""

from __future__ import annotations

from pathlib import Path

from robot_offload.errors import InputError


def must_be_new(path: Path | None, *, force: bool) -> None:
    """Refuse a file that is there already, before anything that takes long.

    Raises:
        InputError: it is there, and nobody said --force.
    """
    if path is not None and path.exists() and not force:
        raise InputError(f"{path} is there already; choose another name, or --force to replace it")


def write_new(path: Path, text: str, *, force: bool) -> None:
    """Write a file.

    Raises:
        InputError: it is there already and nobody said --force, or it cannot be written.
    """
    must_be_new(path, force=force)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error
