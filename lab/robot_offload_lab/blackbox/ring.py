"""The lines of a black box: one file, or the folder in which an agent keeps its ring."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

import robot_offload_core
from robot_offload.errors import InputError
from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Header

PATTERN = "box-*.log"


def lines(place: Path) -> list[str]:
    """Return the lines of a file, or of all files of a folder, the oldest first.

    Raises:
        InputError: `place` has no black box.
    """
    files = sorted(place.glob(PATTERN)) if place.is_dir() else [place]
    try:
        found = [line for file in files for line in file.read_text(encoding="ascii", errors="replace").splitlines()]
    except OSError as error:
        raise InputError(f"{place}: {error.strerror}") from error
    if not any(isinstance(blackbox.parse(line), Header) for line in found):
        raise InputError(
            f"{place} is not a black box: give a file box-NUMBER.log, or its folder (STATE_DIR/blackbox on the robot)"
        )
    return found


def digest_of_core() -> str:
    """Return the name of this installation's core."""
    root = Path(robot_offload_core.__file__).parent
    return blackbox.digest((file.relative_to(root).as_posix(), file.read_bytes()) for file in root.rglob("*.py"))


def clock(wall_s: float) -> str:
    """Return the time of day in this machine's time zone, with milliseconds."""
    return f"{time.strftime('%H:%M:%S', time.localtime(wall_s))}.{int(wall_s % 1 * 1000):03d}"


def moment(text: str, near_wall_s: float) -> float:
    """Return the system time, seconds, of a time of day on the day of `near_wall_s`, or the day before.

    Raises:
        InputError: `text` is not a time of day.
    """
    try:
        hours, minutes, seconds = text.split(":")
        within_s = int(hours) * 3600 + int(minutes) * 60 + float(seconds)
    except ValueError as error:
        raise InputError(f"--around {text}: write a time of day, for example 14:03:20") from error
    day = time.localtime(near_wall_s)
    midnight_s = time.mktime((day.tm_year, day.tm_mon, day.tm_mday, 0, 0, 0, 0, 0, -1))
    found_s = midnight_s + within_s
    return found_s if found_s <= near_wall_s + 60 else found_s - 86_400


def offset_s(header: Header, before_s: float) -> float:
    """Return the seconds to add to the steady clock to get the system clock, from a file's first line."""
    value = header.facts.get("to_wall_s", before_s)
    return float(value) if isinstance(value, int | float) else before_s


def last_wall_s(found: Iterable[str]) -> float:
    """Return the system time of the newest step, seconds; 0 when there is none."""
    newest_s = to_wall_s = 0.0
    for text in found:
        record = blackbox.parse(text)
        if isinstance(record, Header):
            to_wall_s = offset_s(record, to_wall_s)
        elif not isinstance(record, blackbox.Gap):
            newest_s = record.now_s + to_wall_s
    return newest_s
