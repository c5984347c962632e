"""A pod of a pool waits for the end of its calls before it stops."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from robot_offload.api.agent_state import Sight
from robot_offload.render import pool
from robot_offload.reporter import leaving
from robot_offload.reporter.handover import Handovers, Outcome
from robot_offload.reporter.leaving import Leaving
from robot_offload.reporter.metrics import Counts
from robot_offload.reporter.server import application
from robot_offload.reporter.stream import Streams
from tests.unit.operator.reporter.states import seen

POD = "wheelchair-detector-5d9f8-x2x9z"
MEMBER = "pod_wheelchair_detector_5d9f8_x2x9z"


def alive() -> Sight:
    return seen(time.monotonic())


def answer(folder: Path, member: str = MEMBER) -> None:
    """Do what the relay does when a pod has no open call."""
    (folder / "left").mkdir(exist_ok=True)
    (folder / "left" / member).touch()


def served(folder: Path) -> web.Application:
    counts = Counts()
    handovers = Handovers(folder / "handover", alive, time.monotonic)
    streams = Streams(alive, counts, time.monotonic)
    return application(
        alive, counts, handovers, Leaving(folder, alive, time.monotonic), "proof", streams, time.monotonic
    )


def test_a_pod_waits_until_the_relay_says_that_its_calls_are_answered(tmp_path: Path) -> None:
    async def leave_and_be_answered() -> tuple[bool, Outcome]:
        leaving = asyncio.create_task(Leaving(tmp_path, alive, time.monotonic).leave(MEMBER))
        while not (tmp_path / "leaving" / MEMBER).exists():
            await asyncio.sleep(0.01)
        waited = not leaving.done()
        answer(tmp_path)
        return waited, await leaving

    assert asyncio.run(leave_and_be_answered()) == (True, Outcome.DONE)


def test_without_a_living_agent_a_pod_goes_at_once(tmp_path: Path) -> None:
    assert asyncio.run(Leaving(tmp_path, Sight, time.monotonic).leave(MEMBER)) is Outcome.AGENT_SILENT


def test_a_wait_has_an_end(tmp_path: Path) -> None:
    assert asyncio.run(Leaving(tmp_path, alive, time.monotonic, wait_s=0.0).leave(MEMBER)) is Outcome.TOO_LATE


def test_requests_of_pods_that_are_long_gone_are_removed(tmp_path: Path) -> None:
    clock = [1000.0]
    asks = Leaving(tmp_path, lambda: seen(clock[0]), lambda: clock[0])
    answer(tmp_path), answer(tmp_path, "pod_b")
    asyncio.run(asks.leave(MEMBER))
    clock[0] += leaving.FORGET_S + 1.0
    asyncio.run(asks.leave("pod_b"))
    assert [file.name for file in (tmp_path / "leaving").iterdir()] == ["pod_b"]


@pytest.mark.parametrize(
    ("path", "status"),
    [
        (f"/leave/proof/{MEMBER}", 200),
        (f"/leave/other/{MEMBER}", 403),
        ("/leave/proof/..%2Fhandover", 400),
        ("/leave/proof/detector", 400),
        (f"/leave/proof/pod_{'a' * 300}", 400),
    ],
)
def test_only_a_pod_of_this_robot_with_a_pods_name_may_ask(tmp_path: Path, path: str, status: int) -> None:
    answer(tmp_path)

    async def ask() -> int:
        async with TestClient(TestServer(served(tmp_path))) as client:
            return (await client.post(path)).status

    assert asyncio.run(ask()) == status
    assert not (tmp_path / "handover").exists()


def test_the_hook_of_a_pod_asks_by_its_own_name_and_ends_with_the_answer(tmp_path: Path) -> None:
    """The hook is run for real, against the reporter's own application."""

    async def run_hook() -> tuple[int, str]:
        async with TestServer(served(tmp_path)) as server:
            command = pool.pre_stop()["preStop"]["exec"]["command"]
            hook = await asyncio.create_subprocess_exec(
                sys.executable, *command[1:], stdout=subprocess.PIPE,
                env={"PATH": os.environ["PATH"], pool.POD_VARIABLE: POD, pool.WAIT_VARIABLE: "60",
                     pool.URL_VARIABLE: str(server.make_url("/leave/proof")), "http_proxy": "http://127.0.0.1:9"},
            )  # fmt: skip
            answering = threading.Timer(0.2, answer, [tmp_path])
            answering.start()
            told, _ = await hook.communicate()
            answering.join()
            return hook.returncode or 0, told.decode()

    assert asyncio.run(run_hook()) == (0, "")
