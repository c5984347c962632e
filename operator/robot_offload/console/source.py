"""The port between the pages and what they show: a cluster, a recording, or the running demo."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Protocol

from robot_offload.console.actions import Action, Permission
from robot_offload.console.live import Key
from robot_offload.console.model import Event, Fleet

Publish = Callable[[Event], None]
"""Takes what has happened; called on the loop of the pages."""


class Source(Protocol):
    """Where the pages' events come from, and where a person's wishes go."""

    def fleet(self) -> Fleet:
        """Return the empty memory with the title of this source."""
        ...

    async def run(self, publish: Publish) -> None:
        """Publish what happens until it is cancelled; a recording ends by itself. Trouble is published, not raised.

        Raises:
            RobotOffloadError: the source can never be read.
        """
        ...

    async def may(self, key: Key, action: Action) -> Permission:
        """Return whether this person may do that, and why not."""
        ...

    async def act(self, key: Key, action: Action) -> str:
        """Do it and return what was done, a sentence.

        Raises:
            RobotOffloadError: it was refused, with the next step.
        """
        ...

    def watching(self, key: Key) -> contextlib.AbstractContextManager[None]:
        """Ask for all that is known of one robot, for as long as somebody looks at its page."""
        ...
