"""The operator's two small HTTP servers: /metrics for Prometheus, /livez and /readyz for the kubelet."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import structlog
from aiohttp import web
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest

from robot_offload.runtime.health import Signs, healthy
from robot_offload.runtime.settings import Settings

_log = structlog.get_logger("robot_offload.http")


@asynccontextmanager
async def serving(
    settings: Settings, registry: CollectorRegistry, signs: Signs, reached: Callable[[], bool]
) -> AsyncIterator[None]:
    """Serve both while the block runs.

    Args:
        settings: with the ports.
        registry: of the metrics.
        signs: of life.
        reached: whether the API server answered and knows RobotOffload; a standby waiting for leadership is ready.
    """

    async def metrics(_: web.Request) -> web.Response:
        return web.Response(body=generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def readyz(_: web.Request) -> web.Response:
        fine = reached()
        told = {"kind RobotOffload": "listed" if fine else "not listed yet"}
        return web.json_response(told, status=200 if fine else 503)

    async def livez(_: web.Request) -> web.Response:
        fine, told = healthy(signs())
        return web.json_response(told, status=200 if fine else 503)

    runners = []
    try:
        for name, port, answers in (
            ("metrics", settings.metrics_port, {"/metrics": metrics}),
            ("health", settings.health_port, {"/livez": livez, "/readyz": readyz, "/healthz": livez}),
        ):
            application = web.Application()
            for path, answer in answers.items():
                application.router.add_get(path, answer)
            runner = web.AppRunner(application, access_log=None, shutdown_timeout=1)
            runners.append(runner)
            await runner.setup()
            await web.TCPSite(runner, None, port).start()
            _log.info("Serving", what=name, paths=list(answers), port=_port(runner))
        yield
    finally:
        for runner in runners:
            await runner.cleanup()


def _port(runner: web.AppRunner) -> int:
    """Return the IPv4 port: a free one (0) differs for each address family."""
    addresses = sorted(runner.addresses, key=len)
    return int(addresses[0][1])
