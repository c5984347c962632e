"""Reads specifications from files: the thin shell around the pure `api`."""

from __future__ import annotations

from pathlib import Path

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_text
from robot_offload.errors import InputError


def load(path: Path | str) -> RobotOffload:
    """Read the RobotOffload in a YAML file.

    Raises:
        SpecError: the file holds something else or something wrong; every problem is told at once.
        InputError: the file cannot be read.
    """
    return parse_text(read_text(Path(path)), str(path))


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        InputError: it does not exist, is no file, may not be read or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file") from error
    except IsADirectoryError as error:
        raise InputError(f"{path}: is a folder; name the file in it") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start}); save it as UTF-8") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
