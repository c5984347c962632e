"""Files that commands write for a person to edit: an existing file is replaced only on request."""

from __future__ import annotations

from pathlib import Path

from robot_offload.errors import InputError


def must_be_new(path: Path | None, *, force: bool) -> None:
    """Refuse an existing file, before anything that takes long.

    Raises:
        InputError: it exists, and --force was not given.
    """
    if path is not None and path.exists() and not force:
        raise InputError(f"{path} is there already; choose another name, or --force to replace it")


def write_new(path: Path, text: str, *, force: bool) -> None:
    """Write a file.

    Raises:
        InputError: it exists and --force was not given, or it cannot be written.
    """
    must_be_new(path, force=force)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error
