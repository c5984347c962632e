"""The preStop hook, run for real: it asks once, waits for the answer, and never keeps a pod from going."""

from __future__ import annotations

import http.server
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from robot_offload.render import handover


def run(url: str) -> subprocess.CompletedProcess[str]:
    command = handover.pre_stop()["preStop"]["exec"]["command"]
    return subprocess.run(
        [sys.executable, *command[1:]],
        env={"PATH": os.environ["PATH"], handover.URL_VARIABLE: url, "http_proxy": "http://127.0.0.1:9"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@contextmanager
def reporter(status: int) -> Iterator[tuple[str, list[str]]]:
    asked: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            asked.append(self.path)
            self.send_response(status)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the base class calls it
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/handover", asked
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_it_asks_once_past_any_proxy_and_ends_with_the_answer() -> None:
    with reporter(200) as (url, asked):
        done = run(url)
    assert asked == ["/handover"]
    assert (done.returncode, done.stdout) == (0, "")


def test_an_answer_that_came_too_late_is_told_and_the_pod_goes() -> None:
    with reporter(504) as (url, _):
        done = run(url)
    assert done.returncode == 0
    assert "the robot has not confirmed that it takes over" in done.stdout


def test_without_anybody_there_the_pod_goes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    done = run(f"http://127.0.0.1:{port}/handover")
    assert done.returncode == 0
    assert "the robot has not confirmed that it takes over" in done.stdout


def test_the_hook_gives_up_before_the_pod_is_killed() -> None:
    script = handover.pre_stop()["preStop"]["exec"]["command"][2]
    assert "timeout=15" in script
    assert handover.GRACE_S > 15
