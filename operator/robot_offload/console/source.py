"""The port between the pages and their source: a cluster, a recording, or the running demo."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Protocol

from robot_offload.console.actions import Action, Permission
from robot_offload.console.live import Key
from robot_offload.console.model import Event, Fleet

Publish = Callable[[Event], None]
"""Receives events; called on the loop of the pages."""


class Source(Protocol):
    """Provides the pages' events and carries out a person's actions."""

    def fleet(self) -> Fleet:
        """Return an empty memory with the title of this source."""
        ...

    async def run(self, publish: Publish) -> None:
        """Publish events until cancelled; a recording ends by itself. Trouble is published, not raised.

        Raises:
            RobotOffloadError: the source can never be read.
        """
        ...

    async def may(self, key: Key, action: Action) -> Permission:
        """Return whether this user may do that, and why not."""
        ...

    async def act(self, key: Key, action: Action) -> str:
        """Carry out an action and return what was done, as a sentence.

        Raises:
            RobotOffloadError: it was refused; the message has the next step.
        """
        ...

    def watching(self, key: Key) -> contextlib.AbstractContextManager[None]:
        """Request everything known about one robot, while its page is open."""
        ...
