"""The maintenance override: a pin set on the robot itself, kept over restarts, with an optional expiry."""

from __future__ import annotations

import json
import logging
import os
import time
from pathlib import Path

from robot_offload_agent.settings.files import read_text, write_whole
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.control.robot.placement import Wish
from robot_offload_core.fence.token import Site

log = logging.getLogger(__name__)

WORDS = ("Auto", "Robot", "Cloud")


def state_dir(configuration: Configuration) -> Path:
    """Return the folder for data that outlives a reboot."""
    if configuration["state_dir"]:
        return Path(configuration["state_dir"])
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "robot-offload" / configuration["uid"]


class Override:
    """The present override. Its expiry is a person's time, so it is kept on the system clock."""

    def __init__(self, configuration: Configuration) -> None:
        self.path = state_dir(configuration) / "override.json"
        self.word = "Auto"
        self.until_wall_s: float | None = None
        try:
            kept = json.loads(read_text(self.path))
            if kept["override"] not in WORDS:
                raise ValueError(f"{kept['override']!r:.40} is none of {', '.join(WORDS)}")
            until_wall_s = None if kept["until"] is None else float(kept["until"])
            self.word, self.until_wall_s = kept["override"], until_wall_s
        except FileNotFoundError:
            pass  # none was set
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            log.warning("%s is damaged (%s): no override is set; set it again when one is meant", self.path, error)
        self.expire()

    def set(self, word: str, for_s: float) -> None:
        """Set and store it; `for_s` 0 means until it is set to Auto.

        Raises:
            OSError: it cannot be stored; then it is not set either, because it would be forgotten at the next start.
        """
        until_wall_s = _wall_s() + for_s if for_s > 0 and word != "Auto" else None
        write_whole(self.path, json.dumps({"override": word, "until": until_wall_s}), durable=True)
        self.word, self.until_wall_s = word, until_wall_s

    def expire(self) -> bool:
        """Return to Auto when its time is over; return whether that happened now."""
        if self.until_wall_s is None or _wall_s() < self.until_wall_s:
            return False
        self.word, self.until_wall_s = "Auto", None
        return True

    def wish(self, now: float) -> Wish | None:
        """Return the request for the placement machine."""
        if self.word == "Auto":
            return None
        left_s = None if self.until_wall_s is None else self.until_wall_s - _wall_s()
        return Wish(Site(self.word.lower()), None if left_s is None else now + left_s)


def _wall_s() -> float:
    return time.clock_gettime(time.CLOCK_REALTIME)
