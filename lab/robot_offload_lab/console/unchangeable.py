"""What sources without a cluster have in common: they are read-only."""

from __future__ import annotations

import contextlib

from robot_offload.console.actions import Action, Permission
from robot_offload.console.live import Key
from robot_offload.errors import InputError


class Unchangeable:
    """The half of a source that takes a user's requests; `reason`: why it grants none."""

    def __init__(self, reason: str) -> None:
        self._reason = reason

    async def may(self, key: Key, action: Action) -> Permission:
        """Return False: no user may change this."""
        del key, action
        return Permission(False, self._reason)

    async def act(self, key: Key, action: Action) -> str:
        """Refuse."""
        del key, action
        raise InputError(self._reason)

    def watching(self, key: Key) -> contextlib.AbstractContextManager[None]:
        """Need nothing."""
        del key
        return contextlib.nullcontext()
