"""One running console: its source, its memory, and the task that feeds one from the other."""

from __future__ import annotations

import asyncio
import datetime

from robot_offload.console.model import Event, Trouble
from robot_offload.console.source import Source
from robot_offload.errors import RobotOffloadError


class Session:
    """What all tabs of a console share.

    Args:
        source: where everything comes from.

    Attributes:
        fleet: what is known.
        dark: whether new pages are dark; None: as the system is.
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
        """Begin to feed."""
        self._task = asyncio.create_task(self._feed(), name="source")

    async def stop(self) -> None:
        """End the feeding."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def publish(self, event: Event) -> None:
        """Take in what has happened."""
        self.fleet.take(event)

    async def _feed(self) -> None:
        try:
            await self.source.run(self.publish)
        except RobotOffloadError as error:
            self.publish(Trouble(None, str(error)))
