"""What another rule would have done: the lab's replay, if the lab is installed. The operator needs no core for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from typing import Any, Final, Protocol

from robot_offload.console.live import Point
from robot_offload.errors import InputError

GROUP: Final = "robot_offload.console"
"""The entry-point group in which a package lists what it adds to the console."""


class Replay(Protocol):
    """Judges every rule it knows on a period of a link."""

    def __call__(self, points: Sequence[Point], switching: Mapping[str, Any]) -> list[dict[str, str]]:
        """Return a row for each rule: rule, cloud (share of time), changes, exposed (time on a bad link), cost.

        Raises:
            InputError: the period is too short to judge.
        """
        ...


def replay() -> Replay:
    """Return the lab's replay.

    Raises:
        InputError: the lab is not installed.
    """
    for found in entry_points(group=GROUP, name="other_rules"):
        try:
            loaded: Replay = found.load()
        except ImportError as error:
            raise InputError(f"other rules: the lab cannot be loaded ({error})") from error
        return loaded
    raise InputError("Replaying other rules is part of the lab: pip install robot-offload-lab")
