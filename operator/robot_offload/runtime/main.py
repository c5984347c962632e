"""The operator as a process: `python -m robot_offload.runtime.main`, settings from the environment.

First it waits for its kind and for leadership; then it watches, works and renews until it is stopped, or until one of
its parts ends. Nothing is repaired inside a process that has lost a part: it ends, and the kubelet starts it anew.
"""

from __future__ import annotations

import asyncio
import gc
import os
import random
import signal
import sys
import time
from collections.abc import Iterable, Sequence
from typing import Any, Final

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.controller.reconcile import Controller, Name
from robot_offload.controller.store import Store
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.configuration import connect
from robot_offload.kube.errors import KubeError, NotFoundError, NotLeaderError
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.kube.retry import RetryPolicy
from robot_offload.runtime import logs, triggers
from robot_offload.runtime.collector import Collector
from robot_offload.runtime.health import Limit, WatchSight
from robot_offload.runtime.http import serving
from robot_offload.runtime.informer import Informer
from robot_offload.runtime.leadership import Leadership, LeadersOnly, Terms
from robot_offload.runtime.metrics import Metrics
from robot_offload.runtime.queue import Queue
from robot_offload.runtime.settings import Settings, from_environment
from robot_offload.runtime.triggers import SETTLE_S, OthersConfigMaps, Triggers

FEED_S: Final = 30.0
"""Seconds after which passes begin although not everything is listed: one kind that cannot be read holds up nothing."""
_BLIND_LIMIT: Final = 2.5
"""How long the watch may miss something, in times of silence after which it is opened again."""
_log = structlog.get_logger("robot_offload.runtime.main")


class PartEndedError(RobotOffloadError):
    """A part that should run for ever has ended; the process ends with it."""


class Operator:
    """One operator.runtime: the parts and how they hold together."""

    def __init__(
        self, settings: Settings, api: KubeApi, leadership: Leadership, guard: LeadersOnly, clock: Clock | None = None
    ) -> None:
        self._settings = settings
        self._clock = clock or Clock()
        self._leadership = leadership
        self._api = api
        self._store = Store()
        self._controller = Controller(self._api, settings.images, self._clock, self._store, settings.policy)
        self.metrics = Metrics()
        self._queue: Queue[Name] = Queue(self._clock.steady_s, waited=self.metrics.waited.observe)
        self._sight = WatchSight()
        self._collector = Collector(api, self._store, settings.watch_namespaces, settings.pod_namespace, settings.keep)
        self._triggers = Triggers(self._controller, self._store, self._queue, self._sight, self._collector.wake)
        self._others = OthersConfigMaps(self._controller, self._store, self._queue)
        self._probed_s = self._clock.steady_s()
        self._watching = False
        self._reached = False
        self.metrics.show(
            self._statuses,
            lambda: guard.calls,
            lambda: len(self._queue),
            lambda: self._queue.late_s,
            lambda: self._leadership.held,
        )

    # -- the process --------------------------------------------------------------------------------------------

    async def run(self, stop: asyncio.Event) -> None:
        """Runs until `stop` is set.

        Raises:
            RobotOffloadError: a part has ended by itself.
        """
        async with serving(self._settings, self.metrics.registry, self.signs, lambda: self._reached):
            waiting = asyncio.create_task(self._see_the_kind())
            await _first(waiting, asyncio.create_task(stop.wait()))
            if stop.is_set():
                waiting.cancel()
                return
            waiting.result()
            try:
                await self._work(stop)
            finally:
                await self._leadership.release()

    async def _see_the_kind(self) -> None:
        """Waits until the API server answers and our kind exists."""
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

    async def _work(self, stop: asyncio.Event) -> None:
        """Watches, becomes the leader, and then works; who waits for leadership has read everything by then."""
        places, idle_s = self._settings.watch_namespaces, self._settings.inactivity_s
        informers = triggers.informers(
            self._api,
            self._triggers,
            self._others,
            namespaces=places,
            home=self._settings.pod_namespace,
            idle_s=idle_s,
            clock=self._clock,
        )
        parts = [asyncio.create_task(informer.run()) for informer in informers]
        stopped = asyncio.create_task(stop.wait())
        leading = asyncio.create_task(self._leadership.acquire())
        try:
            await _first(leading, *parts, stopped)
            if leading.done():
                leading.result()
                self._lead(parts, informers)
                await _first(*parts, stopped)
        finally:
            await self._end([leading, *parts, stopped])

    def _lead(self, parts: list[asyncio.Task[None]], informers: list[Informer]) -> None:
        """Begins what only the leader does."""
        parts.append(asyncio.create_task(self._leadership.hold()))
        parts.append(asyncio.create_task(self._feed(informers)))
        parts.append(asyncio.create_task(self._probe()))
        parts.append(asyncio.create_task(self._resync()))
        parts.append(asyncio.create_task(self._collector.run(self._settings.resync_s)))
        self._watching = True

    async def _end(self, parts: Sequence[asyncio.Task[Any]]) -> None:
        """Ends all parts.

        Raises:
            RobotOffloadError: one of them has ended by itself.
        """
        _log.info("Stopping")
        for part in parts:
            part.cancel()
        for result in await asyncio.gather(*parts, return_exceptions=True):
            if isinstance(result, RobotOffloadError):
                raise result
            if isinstance(result, Exception):
                raise PartEndedError(f"a part of the operator broke: {result!r}") from result

    async def _feed(self, informers: list[Informer]) -> None:
        """Works on the queue: from the store once that is complete, and before that from the API server itself."""
        listed = asyncio.gather(*(informer.listed.wait() for informer in informers))
        try:
            async with asyncio.timeout(FEED_S):
                await asyncio.shield(listed)
        except TimeoutError:
            late = [informer.kind.kind for informer in informers if not informer.listed.is_set()]
            _log.warning("Works without the store until everything is listed", missing=late)
        if listed.done():
            await self._learn()
        workers = [asyncio.create_task(self._queue.work(self._look)) for _ in range(self._settings.workers)]
        try:
            await _first(listed, *workers)
            if listed.done() and not self._store.fed:
                await self._learn()
            await asyncio.gather(*workers)
        finally:
            for worker in workers:
                worker.cancel()
            listed.cancel()
            await asyncio.gather(*workers, return_exceptions=True)

    async def _learn(self) -> None:
        """Lets passes work from the store, which is complete."""
        await self._controller.preread(self._settings.watch_namespaces)
        self._store.fed = True
        self._controller.resume()
        # What was listed stays: looking through it for garbage again and again would hold everything up.
        gc.collect()
        gc.freeze()
        _log.info("Knows everything", objects=len(self._store))

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
            self._queue.remind(name, result.again_s + SETTLE_S)

    async def _probe(self) -> None:
        """Compares the watch with a list, again and again; what the watch has missed is looked at."""
        while True:
            await asyncio.sleep(self._settings.probe_s * random.uniform(0.9, 1.1))
            try:
                listed = await self._list()
                self._probed_s = self._clock.steady_s()
                for manifest in self._sight.listed(listed, self._probed_s):
                    name = manifest["metadata"]["namespace"], manifest["metadata"]["name"]
                    found = await self._api.get(ROBOT_OFFLOAD, *name)
                    if found is not None and self._store.put(ROBOT_OFFLOAD, found):
                        self._queue.add(name, urgent=True)
            except KubeError as error:
                _log.warning("Could not compare the watch with a list", error=str(error))

    async def _resync(self) -> None:
        """Looks at every object now and then, each at its own time, whatever the events said."""
        while True:
            await asyncio.sleep(self._settings.resync_s)
            self._controller.forget_preread()
            for name in list(self._controller.memories):
                # As an event: a reminder would be put off by every renewal of the robot's Lease.
                self._queue.add(name, random.uniform(0, self._settings.resync_s))

    async def _list(self) -> list[Manifest]:
        """Returns the metadata of all RobotOffloads."""
        found: list[Manifest] = []
        for place in self._settings.watch_namespaces or (None,):
            async for page, _ in self._api.pages(ROBOT_OFFLOAD, place, Selection(metadata_only=True)):
                found += page
        self._reached = True
        return found

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


if __name__ == "__main__":
    sys.exit(main())
