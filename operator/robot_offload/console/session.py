"""One running console: its source, its memory, and the task that feeds the memory."""

from __future__ import annotations

import asyncio
import datetime

from robot_offload.console.model import Event, Trouble
from robot_offload.console.source import Source
from robot_offload.errors import RobotOffloadError


class Session:
    """Shared by all tabs of a console.

    Args:
        source: of all events.

    Attributes:
        fleet: the memory.
        dark: whether new pages are dark; None: as the system.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.fleet = source.fleet()
        self.dark: bool | None = None
        self._task: asyncio.Task[None] | None = None

    def now_s(self) -> float:
        """Return the present on the clock of the events: unix seconds, or the end of a recording."""
        if self.fleet.recorded:
            return max((track.heard_s or 0.0 for track in self.fleet.tracks.values()), default=0.0)
        return datetime.datetime.now(datetime.UTC).timestamp()

    async def start(self) -> None:
        """Start feeding."""
        self._task = asyncio.create_task(self._feed(), name="source")

    async def stop(self) -> None:
        """Stop feeding."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def publish(self, event: Event) -> None:
        """Process an event."""
        self.fleet.take(event)

    async def _feed(self) -> None:
        try:
            await self.source.run(self.publish)
        except RobotOffloadError as error:
            self.publish(Trouble(None, str(error)))
