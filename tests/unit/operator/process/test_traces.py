"""Traces of passes, sent to a real HTTP server."""

from __future__ import annotations

import asyncio
import time
from typing import Any

import pytest
from aiohttp import web

from robot_offload.errors import InputError
from robot_offload.process.settings import from_environment
from robot_offload.process.traces import Traces, trace

NAME = ("ward", "wheelchair-7")
STEPS = [("read", 10.0), ("observe", 10.1), ("apply", 10.4)]
IMAGES = dict.fromkeys(("AGENT_IMAGE", "OPERATOR_IMAGE", "DISCOVERY_IMAGE", "ROUTER_IMAGE"), "registry.example/x:1")


def spans(message: dict[str, Any]) -> list[dict[str, Any]]:
    [resource] = message["resourceSpans"]
    assert {"key": "service.name", "value": {"stringValue": "robot-offload-operator"}} in resource["resource"][
        "attributes"
    ]
    [scope] = resource["scopeSpans"]
    found: list[dict[str, Any]] = scope["spans"]
    return found


def test_a_pass_is_one_trace_with_a_span_for_each_step() -> None:
    whole, *parts = spans(trace(NAME, STEPS, 10.9, False, 10**18))
    assert [part["name"] for part in parts] == ["read", "observe", "apply"]
    assert {part["traceId"] for part in parts} == {whole["traceId"]}
    assert {part["parentSpanId"] for part in parts} == {whole["spanId"]}
    assert (len(whole["traceId"]), len(whole["spanId"]), whole["parentSpanId"]) == (32, 16, "")
    assert (whole["startTimeUnixNano"], whole["endTimeUnixNano"]) == (
        str(10**18 + 10 * 10**9),
        str(10**18 + 10_900_000_000),
    )
    assert parts[1]["endTimeUnixNano"] == parts[2]["startTimeUnixNano"]
    assert {"key": "robotoffload.name", "value": {"stringValue": "wheelchair-7"}} in whole["attributes"]
    assert not any(span["status"] for span in (whole, *parts))


def test_a_step_that_broke_is_an_error_and_so_is_its_pass() -> None:
    whole, *parts = spans(trace(NAME, STEPS, 10.9, True, 0))
    assert whole["status"] == {"code": 2}
    assert [bool(part["status"]) for part in parts] == [False, False, True]


def test_traces_reach_a_collector_and_one_that_is_away_costs_nothing() -> None:
    received: list[dict[str, Any]] = []

    async def take(request: web.Request) -> web.Response:
        received.append(await request.json())
        return web.json_response({}, status=503 if len(received) == 1 else 200)

    async def story() -> None:
        app = web.Application()
        app.add_routes([web.post("/v1/traces", take)])
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        traces = Traces(f"http://127.0.0.1:{runner.addresses[0][1]}/v1/traces")
        for _ in range(300):
            traces.passed(NAME, STEPS, False)
        assert traces.left_out == 300 - 256
        sending = asyncio.create_task(traces.run())
        while len(received) < 256:
            await asyncio.sleep(0.01)
        await runner.cleanup()
        traces.passed(NAME, STEPS, False)
        while traces.left_out < 300 - 256 + 2:  # the 503, and the one that finds nobody
            await asyncio.sleep(0.01)
        sending.cancel()

    asyncio.run(asyncio.wait_for(story(), 60))
    begin = int(spans(received[-1])[0]["endTimeUnixNano"]) / 1e9
    assert abs(begin - time.clock_gettime(time.CLOCK_REALTIME)) < 600


def test_no_endpoint_sends_nothing_and_one_that_is_none_is_refused() -> None:
    environment = {**IMAGES, "POD_NAMESPACE": "x", "POD_NAME": "y"}
    assert from_environment(environment).traces == ""
    with pytest.raises(InputError, match="TRACES_ENDPOINT must be an address"):
        from_environment({**environment, "TRACES_ENDPOINT": "collector:4318"})
