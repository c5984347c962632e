"""The running demo as a source: the demo's thread shows its state, the console's own thread serves the pages."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from robot_offload.cli.lazy import without_extra
from robot_offload.console.actions import Action, Permission
from robot_offload.console.live import Key, Live
from robot_offload.console.model import Declared, Event, Fleet
from robot_offload.console.reading import EventError, of_state
from robot_offload.console.source import Publish
from robot_offload.errors import InputError
from robot_offload_lab.console.told import Teller
from robot_offload_lab.console.wishes import Wishes
from robot_offload_lab.show.view import View
from robot_offload_lab.show.watch import LiveRun

TELL_S: Final = 0.1
START_S: Final = 120.0
"""A busy machine needs half a minute for the imports alone."""
LINGER_S: Final = 1.0


class DemoSource:
    """One running demo.

    Args:
        manifest: of the RobotOffload that runs.
        state_file: of the cloud's agent.
        offset_s: unix time less the steady clock.
        settings_file: that the cloud's agent watches; empty: nothing can be changed.
    """

    def __init__(self, manifest: Mapping[str, Any], state_file: Path, offset_s: float, settings_file: str = "") -> None:
        self._wishes = Wishes(manifest, settings_file, self._declare)
        self._connected = False
        self._key = Key("", str(manifest["metadata"]["name"]))
        self._state_file = state_file
        self._teller = Teller(self._key, offset_s)
        self._told_s = float("-inf")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._publish: Publish | None = None

    def fleet(self) -> Fleet:
        """See `Source.fleet`."""
        return Fleet("demo")

    async def run(self, publish: Publish) -> None:
        """Publish the states of the run that the demo's thread hands over, until cancelled."""
        publish(Declared(self._key, self._wishes.manifest))
        self._loop, self._publish = asyncio.get_running_loop(), publish
        await asyncio.Event().wait()

    def tell(self, watch: LiveRun, now_s: float) -> None:
        """Take the state of the run; called on the demo's thread."""
        loop, publish = self._loop, self._publish
        if loop is None or publish is None or now_s < self._told_s + TELL_S:
            return
        self._told_s = now_s
        cloud = self._cloud()
        self._connected = cloud is not None and cloud.connected
        events = list(self._teller.tell(watch, now_s, cloud))
        with contextlib.suppress(RuntimeError):  # the console has ended
            loop.call_soon_threadsafe(_publish_all, publish, events)

    async def may(self, key: Key, action: Action) -> Permission:
        """Return whether the run accepts a request."""
        del key, action
        return self._wishes.may()

    async def act(self, key: Key, action: Action) -> str:
        """See `Source.act`."""
        del key
        return self._wishes.act(action, connected=self._connected)

    def watching(self, key: Key) -> contextlib.AbstractContextManager[None]:
        """Need nothing."""
        del key
        return contextlib.nullcontext()

    def over(self) -> None:
        """Take the end of the run."""
        self._wishes.over()

    def _declare(self, manifest: Mapping[str, Any]) -> None:
        if self._publish is not None:
            self._publish(Declared(self._key, manifest))

    def _cloud(self) -> Live | None:
        try:
            return of_state(json.loads(self._state_file.read_text(encoding="utf-8")))
        except (OSError, ValueError, EventError):
            return None  # it has not started, or is being written


def _publish_all(publish: Publish, events: list[Event]) -> None:
    for event in events:
        publish(event)


class ConsoleView:
    """A view that shows a run in the browser as well as on the terminal.

    Args:
        view: the terminal's.
        port: of the pages; 0: a free one.
        source: what they show.
    """

    def __init__(self, view: View, port: int, source: DemoSource) -> None:
        self._view = view
        self._source = source
        self._stop: Callable[[], None] = lambda: None
        self._error: Exception | None = None
        ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(port, ready), name="console", daemon=True)
        self._thread.start()
        if not ready.wait(START_S) or self._error is not None:
            raise self._error or InputError("the console did not start within 2 min")

    def _serve(self, port: int, ready: threading.Event) -> None:
        def announce(address: str) -> None:
            self._view.say(f"Console: {address}")
            ready.set()

        async def run() -> None:
            stop, loop = asyncio.Event(), asyncio.get_running_loop()

            def end() -> None:
                loop.call_soon_threadsafe(stop.set)

            self._stop = end
            from robot_offload.console.server import serve  # noqa: PLC0415 - the extra console, and a second of imports

            await serve(self._source, port, announce, stop)

        try:
            asyncio.run(run())
        except ModuleNotFoundError as error:
            self._error = without_extra("demo --console", error)
        except Exception as error:
            self._error = error
        finally:
            ready.set()

    def say(self, text: str) -> None:
        """Show the line on the terminal."""
        self._view.say(text)

    def show(self, watch: LiveRun, now_s: float) -> None:
        """Show the state of the run in both places."""
        self._source.tell(watch, now_s)
        self._view.show(watch, now_s)

    def close(self) -> None:
        """End the picture; the pages go on until `end`."""
        self._source.over()
        self._view.close()

    def end(self) -> None:
        """End the pages."""
        with contextlib.suppress(RuntimeError):
            self._stop()
        self._thread.join(START_S)
