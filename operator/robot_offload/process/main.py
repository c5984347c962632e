"""The operator as a process: `python -m robot_offload.process.main`, settings from the environment.

First it waits for its kind and for leadership; then it watches, works and renews until it is stopped, or until one of
its parts ends. Nothing is repaired inside a process that has lost a part: it ends, and the kubelet starts it anew.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import sys
import time
from collections.abc import Iterable
from typing import Any, Final

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.controller.reconcile import Controller, Name
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.configuration import connect
from robot_offload.kube.errors import KubeError, NotFoundError, NotLeaderError
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.kube.retry import RetryPolicy
from robot_offload.objects import labels
from robot_offload.process import logs, triggers
from robot_offload.process.health import Limit, WatchSight
from robot_offload.process.http import serving
from robot_offload.process.leadership import Leadership, LeadersOnly, Terms
from robot_offload.process.metrics import Metrics
from robot_offload.process.queue import Queue
from robot_offload.process.settings import Settings, from_environment

_SETTLE_S: Final = 0.1
"""How long after an event of a child the pass waits for its siblings' events."""
_BLIND_LIMIT: Final = 2.5
"""How long the watch may miss something, in times of silence after which it is opened again."""
_log = structlog.get_logger("robot_offload.process.main")


class PartEndedError(RobotOffloadError):
    """A part that should run for ever has ended; the process ends with it."""


class Operator:
    """One operator process: the parts and how they hold together."""

    def __init__(
        self, settings: Settings, api: KubeApi, leadership: Leadership, guard: LeadersOnly, clock: Clock | None = None
    ) -> None:
        self._settings = settings
        self._clock = clock or Clock()
        self._leadership = leadership
        self._api = api
        self._controller = Controller(self._api, settings.images, self._clock)
        self._queue: Queue[Name] = Queue(self._clock.steady_s)
        self._sight = WatchSight()
        self._probed_s = self._clock.steady_s()
        self._watching = False
        self._reached = False
        self.metrics = Metrics()
        self.metrics.show(self._statuses, lambda: guard.calls, lambda: len(self._queue), lambda: self._leadership.held)

    # -- triggers (handlers.Triggers) ---------------------------------------------------------------------------

    def resource(self, manifest: Manifest, *, gone: bool) -> None:
        """A RobotOffload has changed."""
        self._sight.delivered(manifest, gone=gone)
        name = manifest["metadata"]["namespace"], manifest["metadata"]["name"]
        if gone or self._controller.news(name, manifest):
            self._queue.add(name)

    def child(self, manifest: Manifest, *, gone: bool) -> None:
        """An object with our labels has changed."""
        name = _owner(manifest)
        if name is not None and (gone or self._controller.news(name, manifest)):
            self._queue.add(name, _SETTLE_S)

    def lease(self, manifest: Manifest, *, gone: bool) -> None:
        """A robot's Lease has changed; renewing alone needs no pass."""
        name = _owner(manifest)
        if name is None:
            return
        settled_s = None if gone else self._controller.saw_lease(name, manifest)
        if settled_s is not None:
            self._queue.postpone(name, settled_s)
        elif gone or self._controller.news(name, manifest):
            self._queue.add(name)

    def config_map(self, manifest: Manifest, *, gone: bool) -> None:
        """A ConfigMap has changed: one of ours, or one that a user's nodes read."""
        self.child(manifest, gone=gone)
        metadata = manifest["metadata"]
        for name, memory in self._controller.memories.items():
            if name[0] == metadata["namespace"] and metadata["name"] in memory.config_maps:
                self._queue.add(name, _SETTLE_S)

    # -- the process --------------------------------------------------------------------------------------------

    async def run(self, stop: asyncio.Event) -> None:
        """Runs until `stop` is set.

        Raises:
            RobotOffloadError: a part has ended by itself.
        """
        async with serving(self._settings, self.metrics.registry, self.signs, lambda: self._reached):
            waiting = asyncio.create_task(self._become_leader())
            await _first(waiting, asyncio.create_task(stop.wait()))
            if stop.is_set():
                waiting.cancel()
                return
            waiting.result()
            try:
                await self._work(stop)
            finally:
                await self._leadership.release()

    async def _become_leader(self) -> None:
        """Waits until our kind exists and nobody else is the leader."""
        told = False
        while True:
            try:
                await self._list()
                break
            except NotFoundError:
                problem = "The kind RobotOffload is not installed; apply its CustomResourceDefinition"
            except KubeError as error:
                problem = str(error)
            if not told:
                _log.warning("Waiting for the API server", problem=problem)
                told = True
            self._leadership.alive()
            await asyncio.sleep(1.0)
        await self._leadership.acquire()

    async def _work(self, stop: asyncio.Event) -> None:
        # kopf cancels every task that is younger than itself when it ends: ours must be older.
        parts = [asyncio.create_task(self._queue.work(self._look)) for _ in range(self._settings.workers)]
        parts.append(asyncio.create_task(self._probe()))
        parts.append(asyncio.create_task(self._resync()))
        leading = asyncio.create_task(self._leadership.hold())
        stopped = asyncio.create_task(stop.wait())
        for manifest in await self._list():
            # At once, without waiting for the watches: whatever a predecessor left half done is finished first.
            self._queue.add((manifest["metadata"]["namespace"], manifest["metadata"]["name"]))
        stop_watching, ready = asyncio.Event(), asyncio.Event()
        watching = asyncio.ensure_future(
            triggers.operator(
                self,
                namespaces=self._settings.watch_namespaces,
                inactivity_s=self._settings.inactivity_s,
                ready=ready,
                stop=stop_watching,
            )
        )
        self._watching = True
        done = await _first(*parts, leading, watching, stopped)
        _log.info("Stopping")
        stop_watching.set()
        for part in (*parts, leading, stopped):
            part.cancel()
        results = await asyncio.gather(*parts, leading, watching, stopped, return_exceptions=True)
        for result in results:
            if isinstance(result, RobotOffloadError):
                raise result
            if isinstance(result, Exception):
                raise PartEndedError(f"a part of the operator broke: {result!r}") from result
        if watching in done and not stop.is_set():
            _log.info("Stopped by a signal")

    async def _look(self, name: Name) -> None:
        """One pass with everything around it: metrics, errors, the next time."""
        began = time.perf_counter()
        try:
            result = await self._controller.reconcile(name)
        except KubeError as error:
            self.metrics.errors.labels(error.reason).inc()
            self.metrics.reconciles.labels("error").inc()
            delay_s = self._queue.retry(name, error.retry_after_s or 0.0)
            _log.warning(
                "Will try again",
                namespace=name[0],
                name=name[1],
                error=str(error),
                reason=error.reason,
                after_s=delay_s,
            )
            return
        except NotLeaderError:
            raise
        except Exception:
            # A bug about one object must not end the service for all others; it is told, counted and tried again.
            self.metrics.errors.labels("Bug").inc()
            self.metrics.reconciles.labels("error").inc()
            _log.exception("A pass broke", namespace=name[0], name=name[1], after_s=self._queue.retry(name))
            return
        finally:
            self.metrics.seconds.observe(time.perf_counter() - began)
        if result.failed:
            self.metrics.reconciles.labels("refused").inc()
            self._queue.retry(name)
        else:
            self.metrics.reconciles.labels("ok").inc()
            self._queue.forgive(name)
        if result.again_s is not None:
            self._queue.remind(name, result.again_s + _SETTLE_S)

    async def _probe(self) -> None:
        """Compares the watch with a list, again and again; what the watch has missed is looked at."""
        while True:
            await asyncio.sleep(self._settings.probe_s * random.uniform(0.9, 1.1))
            try:
                listed = await self._list()
            except KubeError as error:
                _log.warning("Could not compare the watch with a list", error=str(error))
                continue
            self._probed_s = self._clock.steady_s()
            late = {manifest["metadata"]["uid"] for manifest in self._sight.listed(listed, self._probed_s)}
            for manifest in listed:
                name = manifest["metadata"]["namespace"], manifest["metadata"]["name"]
                if manifest["metadata"]["uid"] in late and self._controller.news(name, manifest):
                    self._queue.add(name, _SETTLE_S)

    async def _resync(self) -> None:
        """Looks at every object now and then, each at its own time, whatever the events said."""
        while True:
            await asyncio.sleep(self._settings.resync_s * random.uniform(0.8, 1.2))
            for name in list(self._controller.memories):
                self._queue.remind(name, random.uniform(0, self._settings.resync_s / 5))

    async def _list(self) -> list[Manifest]:
        places = self._settings.watch_namespaces or (None,)
        found = await asyncio.gather(*(self._api.list(ROBOT_OFFLOAD, place) for place in places))
        self._reached = True
        return [manifest for manifests in found for manifest in manifests]

    def signs(self) -> Iterable[Limit]:
        """The signs of life for /livez."""
        now_s = self._clock.steady_s()
        yield Limit("leader loop", now_s - self._leadership.looked_s, max(60.0, 4 * self._settings.lease_s))
        if self._watching:
            yield Limit("watch behind the list", self._sight.blind_s(now_s), _BLIND_LIMIT * self._settings.inactivity_s)
            yield Limit("list", now_s - self._probed_s, max(300.0, 6 * self._settings.probe_s))

    def _statuses(self) -> Iterable[tuple[Name, dict[str, object]]]:
        return [(name, dict(memory.status)) for name, memory in self._controller.memories.items()]


def main() -> int:
    """The process; returns its exit code."""
    try:
        settings = from_environment(os.environ)
    except RobotOffloadError as error:
        print("\n".join(error.lines), file=sys.stderr)  # noqa: T201
        return error.exit_code
    logs.set_up(settings.log_level, settings.log_format)
    try:
        asyncio.run(_run(settings))
    except RobotOffloadError as error:
        _log.error("Ended", reason=type(error).__name__, error=str(error))
        return 1
    _log.info("Ended")
    return 0


async def _run(settings: Settings) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    # Its own connection and no patience: renewing must not queue behind the work.
    leader_api = connect(retry=RetryPolicy(attempts=1, request_timeout_s=settings.lease_s / 5))
    lease_s = settings.lease_s
    terms = Terms(duration_s=lease_s, renew_s=lease_s / 3, give_up_s=lease_s * 2 / 3)
    leadership = Leadership(leader_api, settings.pod_namespace, settings.pod_name, terms=terms)
    guard = LeadersOnly(leadership)
    api = connect(retry=RetryPolicy(request_timeout_s=settings.request_s), guard=guard)
    try:
        await Operator(settings, api, leadership, guard).run(stop)
    finally:
        await api.close()
        await leader_api.close()


async def _first(*tasks: asyncio.Future[Any]) -> set[asyncio.Future[Any]]:
    done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    return done


def _owner(manifest: Manifest) -> Name | None:
    """The RobotOffload that an object belongs to by its label."""
    metadata = manifest["metadata"]
    instance = (metadata.get("labels") or {}).get(labels.INSTANCE)
    return (metadata["namespace"], instance) if instance and metadata.get("namespace") else None


if __name__ == "__main__":
    sys.exit(main())
