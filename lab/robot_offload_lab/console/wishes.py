"""What a user may change in a running demo: the same as in a cluster, without an API server.

The cloud's agent offers settings to the robot, as it does those of an operator; here the console writes them.
"""

from __future__ import annotations

import asyncio
import datetime
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from robot_offload.api.v1alpha1 import pinned
from robot_offload.console import actions
from robot_offload.console.actions import Action, Permission
from robot_offload.errors import InputError
from robot_offload.insight.observed import observe
from robot_offload.render.agent_config import parameter_file

OVER: Final = "the run is over"
ONE_SIDE: Final = "one side runs alone, so there is nowhere to switch to; run the demo with both"
WORDS: Final = ("mode", "pin")
"""Fields of spec.switching that buttons change."""


class Wishes:
    """The settings of one run.

    Args:
        manifest: of the RobotOffload that runs.
        file: that the cloud's agent watches; empty: the run has one side.
        changed: called with the manifest after each change.
    """

    def __init__(self, manifest: Mapping[str, Any], file: str, changed: Callable[[Mapping[str, Any]], None]) -> None:
        self.manifest = manifest
        self._file = Path(file) if file else None
        self._changed = changed
        self._generation = 0
        self._end: asyncio.Task[None] | None = None
        self.refusal = "" if file else ONE_SIDE
        if file:
            self._write()

    def over(self) -> None:
        """Take the end of the run: requests are no longer accepted."""
        self.refusal = self.refusal or OVER

    def may(self) -> Permission:
        """Return whether anything can be changed now."""
        return Permission(not self.refusal, self.refusal)

    def act(self, action: Action, *, connected: bool) -> str:
        """Do it and return what was done; a timer here ends a pin for a limited time.

        Raises:
            InputError: nothing can be changed now.
        """
        if self.refusal:
            raise InputError(self.refusal)
        now = datetime.datetime.now(datetime.UTC)
        self._patch(actions.patch(action, "", now))
        if self._end is not None:
            self._end.cancel()
        until = observe(self.manifest).pinned_until
        left_s = (datetime.datetime.fromisoformat(until) - now).total_seconds() if until else None
        self._end = None if left_s is None else asyncio.create_task(self._let_go(left_s), name="end of the pin")
        return actions.done(action, observe({**self.manifest, "status": {"robot": {"connected": connected}}}))

    async def _let_go(self, after_s: float) -> None:
        await asyncio.sleep(max(0.0, after_s))
        if not self.refusal:
            self._end = None
            self._patch(actions.patch(Action(actions.Want.AUTO), "", datetime.datetime.now(datetime.UTC)))

    def _patch(self, body: Mapping[str, Any]) -> None:
        """Apply a change as the API server would, and offer it."""
        metadata, spec = dict(self.manifest["metadata"]), dict(self.manifest["spec"])
        spec["switching"] = {**(spec.get("switching") or {}), **body["spec"]["switching"]}
        if "annotations" in body["metadata"]:
            until = body["metadata"]["annotations"][pinned.PINNED_UNTIL]
            metadata["annotations"] = {pinned.PINNED_UNTIL: until} if until else {}
        metadata["generation"] = self._generation + 1
        self.manifest = {**self.manifest, "metadata": metadata, "spec": spec}
        self._write()
        self._changed(self.manifest)

    def _write(self) -> None:
        """Write the settings of the next generation as a whole."""
        assert self._file is not None
        self._generation += 1
        switching = self.manifest["spec"].get("switching") or {}
        words = {word: switching[word] for word in WORDS if word in switching}
        beside = self._file.with_suffix(".new")
        beside.write_text(parameter_file({"generation": self._generation, **words}, "the demo's console"), "utf-8")
        beside.replace(self._file)
