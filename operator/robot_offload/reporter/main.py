"""The reporter's process: it reads the state file, mirrors it, serves HTTP, and stops in an orderly way."""

from __future__ import annotations

import asyncio
import datetime
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import structlog
from aiohttp import web

from robot_offload.api.agent_state import Sight, look
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.configuration import connect
from robot_offload.kube.retry import RetryPolicy
from robot_offload.reporter import mirror
from robot_offload.reporter.handover import WAIT_S, Handovers
from robot_offload.reporter.leases import WRITE_WITHIN_S, ClusterLease, Leases
from robot_offload.reporter.leaving import Leaving
from robot_offload.reporter.metrics import Counts
from robot_offload.reporter.offered import OfferedSettings
from robot_offload.reporter.server import application
from robot_offload.reporter.settings import ReporterSettings, read_settings
from robot_offload.reporter.stream import Streams

LOOK_EVERY_S: Final = 0.25
LOOK_LIVE_S: Final = 0.1
"""How soon a change is shown while a client follows the stream."""
log = structlog.get_logger("robot_offload.reporter")


def main() -> None:
    """Run the reporter until SIGTERM or SIGINT."""
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.JSONRenderer(),
        ],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )
    try:
        settings = read_settings(os.environ)
    except RobotOffloadError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)
    asyncio.run(_run(settings))


async def _run(settings: ReporterSettings) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    api = connect(retry=RetryPolicy(attempts=1, request_timeout_s=WRITE_WITHIN_S))
    wanted, offered = settings.offered, None
    if wanted is not None:
        offered = OfferedSettings(api, settings.namespace, wanted)
    try:
        await Reporter(settings, ClusterLease(settings.namespace, settings.lease), offered).run(stop)
    finally:
        await api.close()


class Reporter:
    """The running reporter.

    Args:
        settings: names and places.
        leases: the target of the mirrored state.
        offered: keeps the agent's settings file current; None: not needed.
    """

    def __init__(self, settings: ReporterSettings, leases: Leases, offered: OfferedSettings | None = None) -> None:
        self._offered = offered
        self._settings = settings
        self._leases = leases
        self._sight = Sight()
        self._mirror = mirror.Mirror()
        self._counts = Counts()
        self._handovers = Handovers(settings.handover_file, lambda: self._sight, time.monotonic)
        self._leaving = Leaving(settings.handover_file.parent, lambda: self._sight, time.monotonic)
        self._streams = Streams(lambda: self._sight, self._counts, time.monotonic)

    async def run(self, stop: asyncio.Event) -> None:
        """Work until `stop` is set; then finish the present handover and report the last state."""
        proof = self._settings.handover_proof
        app = application(
            lambda: self._sight, self._counts, self._handovers, self._leaving, proof, self._streams, time.monotonic
        )
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=WAIT_S)
        await runner.setup()
        site = web.TCPSite(runner, None, self._settings.port)
        await site.start()
        log.info("serving", addresses=[list(address[:2]) for address in runner.addresses], lease=self._settings.lease)
        looking = asyncio.create_task(self._keep_looking())
        mirroring = asyncio.create_task(self._keep_mirroring())
        offering = asyncio.create_task(self._offered.keep() if self._offered else stop.wait())
        stopped = asyncio.create_task(stop.wait())
        try:
            await asyncio.wait([looking, mirroring, offering, stopped], return_when=asyncio.FIRST_COMPLETED)
            await self._handovers.finish()
        finally:
            for task in (mirroring, offering, looking, stopped):
                task.cancel()
            await asyncio.gather(mirroring, offering, looking, stopped, return_exceptions=True)
            await runner.cleanup()
            await self._tell_the_last()
            await self._leases.close()
        for task in (looking, mirroring, offering):
            if not task.cancelled() and (error := task.exception()) is not None:
                raise error
        log.info("stopped")

    async def _keep_looking(self) -> None:
        while True:
            text, ago_s = _read(self._settings.state_file)
            before = self._sight
            self._sight = look(before, text, time.monotonic(), written_ago_s=ago_s)
            if self._sight.problem and self._sight.problem != before.problem:
                log.warning("the agent's state cannot be used", problem=self._sight.problem)
            if self._sight is not before:
                self._streams.wake()
            await asyncio.sleep(LOOK_LIVE_S if self._streams.clients else LOOK_EVERY_S)

    async def _keep_mirroring(self) -> None:
        while True:
            wanted = mirror.report(self._sight, time.monotonic())
            if wanted is not None and mirror.due(self._mirror, wanted, time.monotonic()):
                await self._write(wanted)
            await asyncio.sleep(LOOK_EVERY_S)

    async def _write(self, wanted: mirror.Report) -> None:
        patch = mirror.patch(wanted, self._settings.robot, datetime.datetime.now(datetime.UTC))
        try:
            async with asyncio.timeout(WRITE_WITHIN_S):
                await self._leases.write(patch)
        except (RobotOffloadError, TimeoutError, OSError) as error:
            self._counts.lease_failures += 1
            if self._mirror.failures == 0:  # once an outage, not at each attempt
                log.warning("the Lease cannot be written; trying on", error=str(error) or type(error).__name__)
            self._mirror = mirror.failed(self._mirror, time.monotonic())
            return
        if self._mirror.failures:
            log.info("the Lease can be written again", failures=self._mirror.failures)
        self._counts.lease_writes += 1
        self._mirror = mirror.succeeded(wanted, time.monotonic())

    async def _tell_the_last(self) -> None:
        """Write once more if there is news, so that the next reporter starts from the truth."""
        wanted = mirror.report(self._sight, time.monotonic())
        if wanted is not None and wanted != self._mirror.written and not self._mirror.failures:
            await self._write(wanted)


def _read(file: Path) -> tuple[str | None, float]:
    """Return the file's content and how many seconds ago it was written; None: it cannot be read."""
    with suppress(OSError, UnicodeDecodeError):
        ago_s = datetime.datetime.now(datetime.UTC).timestamp() - file.stat().st_mtime
        return file.read_text(encoding="utf-8"), ago_s
    return None, 0.0
