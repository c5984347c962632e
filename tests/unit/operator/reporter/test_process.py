"""The reporter as a real process: a state file is replaced under it, a small API server takes or refuses its writes."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload.api.agent_state import ANNOTATION
from robot_offload.reporter.mirror import RENEW_S
from tests.unit.operator.reporter.running import PATIENCE_S, PROOF, Running, eventually
from tests.unit.operator.reporter.states import text

LEASE = "/apis/coordination.k8s.io/v1/namespaces/ward/leases/wheelchair-7-robot"


class ApiServer:
    """Remembers the patches it gets; `status` is what it answers."""

    def __init__(self) -> None:
        self.patches: list[dict[str, Any]] = []
        self.requests: list[str] = []
        self.status = 200
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_PATCH(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                server.requests.append(f"PATCH {self.path.split('?')[0]}")
                answer = json.dumps(body if server.status == 200 else {"kind": "Status", "message": "not now"}).encode()
                status = server.status
                if status == 200:  # before the answer, after which the reporter may end and the test look
                    server.patches.append(body)
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(answer)))
                self.end_headers()
                self.wfile.write(answer)

            def log_message(self, *_: object) -> None:
                """Quiet."""

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        self._thread.start()
        self.url = f"http://127.0.0.1:{self._http.server_port}"

    def kubeconfig(self, file: Path) -> Path:
        values = {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": "c", "cluster": {"server": self.url}}],
            "users": [{"name": "u", "user": {"token": "t"}}],
            "contexts": [{"name": "x", "context": {"cluster": "c", "user": "u"}}],
            "current-context": "x",
        }
        file.write_text(yaml.safe_dump(values))
        return file

    def close(self) -> None:
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()


@pytest.fixture
def api() -> Iterator[ApiServer]:
    server = ApiServer()
    yield server
    server.close()


@pytest.fixture
def running(tmp_path: Path, api: ApiServer) -> Iterator[Running]:
    process = Running(tmp_path, api.kubeconfig(tmp_path / "kubeconfig"))
    yield process
    process.stop()


def told(api: ApiServer) -> dict[str, Any]:
    """The state in the newest patch."""
    return dict(json.loads(api.patches[-1]["metadata"]["annotations"][ANNOTATION]))


def test_before_the_agent_starts_the_reporter_lives_and_is_not_ready(running: Running, api: ApiServer) -> None:
    assert running.ask("/healthz") == (200, "ok\n")
    status, page = running.ask("/readyz")
    assert (status, page) == (503, "there is no state file: the agent has not started\n")
    assert running.ask("/state")[0] == 503
    assert api.requests == []


def test_the_state_reaches_probes_metrics_and_lease(running: Running, api: ApiServer) -> None:
    begin_s = time.monotonic()
    running.live(text())
    eventually(lambda: api.patches)
    assert running.ask("/readyz") == (200, "ok\n")
    assert json.loads(running.ask("/state")[1])["round_trip_ms"] == {"p50": 11.5, "p99": 19.0}
    assert "robot_offload_robot_connected 1.0" in running.ask("/metrics")[1]
    assert api.patches[0]["spec"]["holderIdentity"] == "wheelchair-7"
    assert set(api.requests) == {f"PATCH {LEASE}"}
    for second in range(6):  # only the live numbers change
        running.live(text(written=f"later {second}", round_trip_ms={"p50": float(second)}))
        time.sleep(0.3)
    renewals = (time.monotonic() - begin_s) // RENEW_S  # on a machine that is so slow
    assert len(api.patches) <= 1 + renewals
    running.live(text(connected=False, site="robot"))
    eventually(lambda: told(api)["site"] == "robot")
    assert api.patches[-1]["spec"]["holderIdentity"] is None


def test_an_outage_of_the_api_server_is_survived_and_the_newest_state_is_told(running: Running, api: ApiServer) -> None:
    api.status = 503
    running.live(text(site="robot"))
    eventually(lambda: len(api.requests) >= 2)
    running.live(text(site="cloud", epoch=13))
    api.status = 200
    # A patch with the older state may have been on its way when the server came back.
    eventually(lambda: api.patches and (told(api)["site"], told(api)["epoch"]) == ("cloud", 13))
    assert running.ask("/healthz")[0] == 200


def test_a_pod_that_stops_waits_until_the_robot_acts(running: Running) -> None:
    async def hand_over() -> tuple[int, str]:
        asked = asyncio.create_task(asyncio.to_thread(running.ask, f"/handover/{PROOF}", "POST"))
        identifier = await asyncio.to_thread(eventually, lambda: _content(running.handover_file))
        assert not asked.done()
        running.live(text(site="robot", handover=identifier))
        return await asked

    running.live(text())
    eventually(lambda: running.ask("/readyz")[0] == 200)
    status, page = asyncio.run(hand_over())
    assert status == 200
    assert json.loads(page)["handover"] == running.handover_file.read_text().strip()
    assert "robot_offload_handovers_total 1.0" in running.ask("/metrics")[1]


def test_who_does_not_know_the_robots_own_word_asks_for_no_handover(running: Running) -> None:
    running.live(text())
    eventually(lambda: running.ask("/readyz")[0] == 200)
    assert running.ask("/handover/guessed", "POST")[0] == 403
    assert running.ask("/handover", "POST")[0] == 404
    assert not running.handover_file.exists()


def test_without_a_living_agent_nobody_waits(running: Running) -> None:
    status, page = running.ask(f"/handover/{PROOF}", "POST")
    assert (status, json.loads(page)["reason"]) == (503, "AgentSilent")


def test_a_stop_tells_the_last_state_and_ends_with_0(running: Running, api: ApiServer) -> None:
    running.live(text())
    eventually(lambda: api.patches)
    running.live(text(site="robot"))
    eventually(lambda: json.loads(running.ask("/state")[1])["site"] == "robot")
    assert running.stop() == 0
    assert told(api)["site"] == "robot"


def test_a_stop_waits_for_the_handover_that_is_under_way(running: Running) -> None:
    async def stop_meanwhile() -> tuple[int, str]:
        asked = asyncio.create_task(asyncio.to_thread(running.ask, f"/handover/{PROOF}", "POST"))
        identifier = await asyncio.to_thread(eventually, lambda: _content(running.handover_file))
        running.process.send_signal(signal.SIGTERM)
        await asyncio.sleep(0.5)
        assert running.process.poll() is None, "the reporter waits"
        running.live(text(handover=identifier))
        return await asked

    running.live(text())
    eventually(lambda: running.ask("/readyz")[0] == 200)
    assert asyncio.run(stop_meanwhile())[0] == 200
    assert running.process.wait(PATIENCE_S) == 0


def test_an_environment_that_lacks_something_ends_with_2() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "NAMESPACE"}
    done = subprocess.run(
        [sys.executable, "-m", "robot_offload.reporter"], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "NAMESPACE" in done.stderr
    assert "Traceback" not in done.stderr


def _content(file: Path) -> str:
    return file.read_text().strip() if file.exists() else ""
