"""A pod of a pool leaves: the file with the request to the cloud's relay, and the wait for the pod's calls."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from robot_offload.api.agent_state import Sight
from robot_offload.reporter.handover import LOOK_EVERY_S, Outcome

MEMBER: Final = re.compile(r"pod_[a-z0-9_]{1,253}")
"""A pod's own name in its ROS form: see `render/pool.py`."""
LONGEST_S: Final = 630.0
"""A call may take ten minutes; the pod itself gives up sooner if its calls are shorter."""
FORGET_S: Final = 3600.0
"""How long a request is kept: the pod is then gone, and its name is never used again."""


class Leaving:
    """Asks the relay to give certain pods no new calls.

    Args:
        folder: the agent's runtime folder; requests are in `leaving`, answers in `left`.
        sight: the agent's state as last seen.
        now: the steady clock in seconds.
        wait_s: maximum wait of a request.
    """

    def __init__(
        self, folder: Path, sight: Callable[[], Sight], now: Callable[[], float], wait_s: float = LONGEST_S
    ) -> None:
        self._asked, self._answered = folder / "leaving", folder / "left"
        self._sight = sight
        self._now = now
        self._wait_s = wait_s
        self._asked_s: dict[str, float] = {}

    async def leave(self, member: str) -> Outcome:
        """Ask for a pod, and wait until it has no open call; raise OSError if the file cannot be written.

        A pod that asks again, because its first request was cut, gets the same answer.
        """
        self._asked.mkdir(exist_ok=True)
        self._forget(member)
        (self._asked / member).touch()
        deadline_s = self._now() + self._wait_s
        while not (self._answered / member).exists():
            if not self._sight().fresh(self._now()):
                return Outcome.AGENT_SILENT
            if self._now() >= deadline_s:
                return Outcome.TOO_LATE
            await asyncio.sleep(LOOK_EVERY_S)
        return Outcome.DONE

    def _forget(self, newest: str) -> None:
        self._asked_s[newest] = self._now()
        for member, asked_s in list(self._asked_s.items()):
            if self._now() - asked_s > FORGET_S:
                del self._asked_s[member]
                (self._asked / member).unlink(missing_ok=True)
