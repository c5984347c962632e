"""`robot-offload demo --console`: pages beside a running demo, and after it until the user ends them."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path

from rich.console import Console

from robot_offload_lab.console.running import ConsoleView, DemoSource
from robot_offload_lab.run.demo import manifest
from robot_offload_lab.run.system import System
from robot_offload_lab.show.view import View
from robot_offload_lab.wire.loop import steady_s


class ConsolePages:
    """The pages of one run; `port` 0: a free one."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._view: ConsoleView | None = None

    def show(self, view: View, system: System) -> View:
        """Begin to serve, and return the view that feeds terminal and pages."""
        offset_s = time.clock_gettime(time.CLOCK_REALTIME) - steady_s()
        source = DemoSource(manifest(system.offload), Path(system.state_file), offset_s, system.settings_file)
        self._view = ConsoleView(view, self._port, source)
        return self._view

    def linger(self, terminal: Console) -> None:
        """Serve the finished run until Ctrl-C or SIGTERM."""
        if self._view is None:
            return
        terminal.print("The run is over; the console shows it until Ctrl-C", markup=False, highlight=False)
        asked = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda *_: asked.set())
        asked.wait()
        self._view.end()
