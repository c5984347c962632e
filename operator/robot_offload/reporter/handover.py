"""Handing over before a pod of the active side stops: the file that asks the agent, and the wait for its answer."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from robot_offload.api.agent_state import Sight

WAIT_S: Final = 13.0
"""The caller gives up after 15 s, and its pod's grace period is 20 s."""
LOOK_EVERY_S: Final = 0.05


class Outcome(Enum):
    """The end of a handover."""

    DONE = "Done"
    AGENT_SILENT = "AgentSilent"
    TOO_LATE = "TooLate"


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a handover's caller.

    Attributes:
        outcome: the end of the handover.
        id: the handover's id.
        message: one sentence.
    """

    outcome: Outcome
    id: str
    message: str


def judge(identifier: str, sight: Sight, now_s: float, deadline_s: float) -> Answer | None:
    """Return the answer if a handover has ended; None: wait on.

    Args:
        identifier: the id written for the agent.
        sight: the agent's state as last seen.
        now_s: the steady clock.
        deadline_s: end of the wait, on the same clock.
    """
    if sight.state is not None and sight.state.handover == identifier:
        return Answer(Outcome.DONE, identifier, "the robot acts; this pod may go")
    if not sight.fresh(now_s):
        return Answer(Outcome.AGENT_SILENT, identifier, "no living agent here, so the cloud does not act")
    if now_s >= deadline_s:
        return Answer(Outcome.TOO_LATE, identifier, "the robot has not taken over in time; its own loss detection will")
    return None


class Handovers:
    """Asks the agent to hand over; requests that come while one is under way share it.

    Args:
        file: watched by the agent.
        sight: the agent's state as last seen.
        now: the steady clock in seconds.
        wait_s: maximum wait of a request.
    """

    def __init__(
        self, file: Path, sight: Callable[[], Sight], now: Callable[[], float], wait_s: float = WAIT_S
    ) -> None:
        self._file = file
        self._sight = sight
        self._now = now
        self._wait_s = wait_s
        self._running: asyncio.Task[Answer] | None = None

    async def hand_over(self) -> Answer:
        """Have the robot take over and wait for it."""
        if self._running is None or self._running.done():
            self._running = asyncio.create_task(self._hand_over())
        # A caller that hangs up must not end the handover of the others.
        return await asyncio.shield(self._running)

    async def finish(self) -> None:
        """Wait for the present handover, if any."""
        if self._running is not None:
            await asyncio.wait([self._running])

    async def _hand_over(self) -> Answer:
        identifier = secrets.token_hex(16)
        deadline_s = self._now() + self._wait_s
        new = self._file.with_name(f"{self._file.name}.new")
        new.write_text(f"{identifier}\n", encoding="ascii")
        new.replace(self._file)
        while (answer := judge(identifier, self._sight(), self._now(), deadline_s)) is None:
            await asyncio.sleep(LOOK_EVERY_S)
        return answer
