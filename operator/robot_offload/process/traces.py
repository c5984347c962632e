"""A trace of each pass over a RobotOffload: OTLP over HTTP in its JSON form, off without an endpoint.

A span for the pass and one for each of its steps, written as the OpenTelemetry protocol says (OTLP 1.x, "JSON Protobuf
Encoding"): ids in hexadecimal, times as text in Unix nanoseconds. No SDK: one message of one shape needs none, and the
operator's image stays as it is. Traces may be lost, a pass never waits for them.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, Final

import aiohttp
import structlog

_WAITING: Final = 256
"""Passes that wait to be sent; more of them are left out."""
_SEND_WITHIN_S: Final = 5.0
_INTERNAL: Final = 1
"""Kind of the spans."""
_ERROR: Final = 2
"""Status of a span that failed; others have none."""
_log = structlog.get_logger("robot_offload.process")


class Traces:
    """Sends traces to an endpoint.

    Args:
        endpoint: address, e.g. http://collector.monitoring:4318/v1/traces; empty: nothing is sent.

    Attributes:
        left_out: passes that were not sent.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._waiting: asyncio.Queue[dict[str, Any]] = asyncio.Queue(_WAITING)
        self._failed = False
        self.left_out = 0

    def passed(self, name: tuple[str, str], steps: Sequence[tuple[str, float]], broken: bool) -> None:
        """Takes one pass that has just ended.

        Args:
            name: namespace and name of the RobotOffload.
            steps: each with the time at which it began, in seconds on the steady clock.
            broken: whether the last step broke off.
        """
        try:
            self._waiting.put_nowait(trace(name, steps, time.monotonic(), broken, time.time_ns() - time.monotonic_ns()))
        except asyncio.QueueFull:
            self.left_out += 1

    async def run(self) -> None:
        """Sends what waits, for ever; an endpoint that does not answer is logged once."""
        if not self._endpoint:
            await asyncio.Event().wait()
        async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=_SEND_WITHIN_S)) as session:
            while True:
                await self._send(session, await self._waiting.get())

    async def _send(self, session: aiohttp.ClientSession, body: dict[str, Any]) -> None:
        try:
            async with session.post(self._endpoint, json=body) as answer:
                answer.raise_for_status()
        except (aiohttp.ClientError, TimeoutError, OSError) as error:
            self.left_out += 1
            if not self._failed:
                _log.warning("Traces cannot be sent", endpoint=self._endpoint, error=str(error))
            self._failed = True
        else:
            self._failed = False


def trace(
    name: tuple[str, str], steps: Sequence[tuple[str, float]], ended_s: float, broken: bool, offset_ns: int
) -> dict[str, Any]:
    """Returns the message of one pass.

    Args:
        name: see `Traces.passed`, as `steps` and `broken`.
        steps: see there.
        broken: see there.
        ended_s: when the pass ended, on the same clock.
        offset_ns: system clock minus steady clock.
    """
    identity, whole = secrets.token_hex(16), secrets.token_hex(8)
    moments = [moment_s for _, moment_s in steps]
    times = [str(round(moment_s * 1e9) + offset_ns) for moment_s in (*moments, ended_s)]

    def span(own: str, word: str, begin: str, end: str, parent: str, broke: bool) -> dict[str, Any]:
        status = {"code": _ERROR} if broke else {}
        of = {"traceId": identity, "spanId": own, "parentSpanId": parent, "name": word, "kind": _INTERNAL}
        return {**of, "startTimeUnixNano": begin, "endTimeUnixNano": end, "status": status}

    root = span(whole, "reconcile", times[0], times[-1], "", broken)
    root["attributes"] = _attributes({"k8s.namespace.name": name[0], "robotoffload.name": name[1]})
    parts = [
        span(secrets.token_hex(8), word, times[index], times[index + 1], whole, broken and index == len(steps) - 1)
        for index, (word, _) in enumerate(steps)
    ]
    about = {"service.name": "robot-offload-operator", "service.version": version("robot-offload")}
    scope = {"scope": {"name": "robot_offload.controller"}, "spans": [root, *parts]}
    return {"resourceSpans": [{"resource": {"attributes": _attributes(about)}, "scopeSpans": [scope]}]}


def _attributes(values: dict[str, str]) -> list[dict[str, Any]]:
    return [{"key": key, "value": {"stringValue": value}} for key, value in values.items()]
