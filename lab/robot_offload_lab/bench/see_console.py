"""The console's figures: how late a change is on the screen, and the processor time of its server.

A real API server, a real reporter behind its proxy, whose state file this process writes as a cloud agent does (five
times a second), the console as a process, and a headless Chromium. A change is a new state file; it is on the screen
when the frame after the change of the page has been drawn.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil

from robot_offload.cli.cluster import Target
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.errors import AlreadyExistsError
from robot_offload.kube.kinds import NAMESPACE, POD, ROBOT_OFFLOAD, SERVICE
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects.names import AGENT, child_name
from robot_offload_lab.bench.operator_world import control_plane
from robot_offload_lab.bench.see_figures import SeeFigure

ROBOTS: Final = 200
PLACE: Final = "bench-see"
CHANGES: Final = 60
BEAT_S: Final = 0.2
WATCHED_S: Final = 20.0
PATIENCE_S: Final = 60.0
BROWSERS: Final = ("chromium-headless-shell", "chromium")
FLAGS: Final = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking")
WATCH: Final = """() => {
  window.seen = {};
  const look = () => {
    const text = document.querySelector(".mark-reason").innerText;
    requestAnimationFrame(() => setTimeout(() => {
      if (!(text in window.seen)) window.seen[text] = performance.timeOrigin + performance.now();
    }, 0));
  };
  new MutationObserver(look).observe(document.body, {subtree: true, childList: true, characterData: true});
}"""


def measure(out: Path) -> list[SeeFigure]:
    """Measures with one robot on its page, and with two hundred in the table."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise RobotOffloadError(f"there is no browser: install {BROWSERS[0]}")
    with control_plane(None) as kubeconfig, _reporter(out, kubeconfig) as agent:
        port = agent.port()
        Target(str(kubeconfig)).run(lambda api: _make(api, port))
        agent.start()
        with _served(kubeconfig) as (address, process), _browser(program) as browser:
            page = browser.new_page()
            fleet = list(_fleet(page, address, process))
            robot = list(_robot(page, address, process, agent))
    return [*fleet, *robot]


def _fleet(page: Any, address: str, process: psutil.Process) -> Iterator[SeeFigure]:
    page.goto(address)
    began_s = time.monotonic()
    page.goto(address.partition("?")[0])
    page.wait_for_function(f"document.querySelectorAll('.console-fleet tbody tr').length == {ROBOTS}")
    yield SeeFigure(f"page with {ROBOTS} robots complete", time.monotonic() - began_s, "s", "< 2 s")
    page.wait_for_timeout(5000)
    percent = _percent(process)
    yield SeeFigure(f"server, table of {ROBOTS} robots open, five updates a second", percent, "% of a core", "< 25 %")


def _robot(page: Any, address: str, process: psutil.Process, agent: Agent) -> Iterator[SeeFigure]:
    began_s = time.monotonic()
    page.goto(f"{address.partition('?')[0]}robot/{PLACE}/{_name(0)}")
    page.wait_for_selector("canvas")
    page.wait_for_function("document.querySelector('.mark-line').innerText.includes('latency')")
    yield SeeFigure("page of one robot complete", time.monotonic() - began_s, "s", "< 2 s")
    page.wait_for_timeout(3000)
    percent = _percent(process)
    yield SeeFigure("server, page of one robot open, five updates a second", percent, "% of a core", "< 25 %")
    page.evaluate(WATCH)
    written = {}
    for number in range(CHANGES):
        text = f"change {number}"
        written[f"LinkGood: {text}"] = agent.change(text)
        page.wait_for_timeout(500 + number * 37 % 200)
    page.wait_for_timeout(2000)
    seen = page.evaluate("window.seen")
    late_ms = [seen[text] - at_ms for text, at_ms in written.items() if text in seen]
    for quantile in (50, 99):
        value = float(np.percentile(late_ms, quantile)) if late_ms else None
        yield SeeFigure(f"change of the agent's state to the screen, p{quantile} of {len(late_ms)}", value, "ms")


def _percent(process: psutil.Process) -> float:
    before, began_s = process.cpu_times(), time.monotonic()
    time.sleep(WATCHED_S)
    after = process.cpu_times()
    used_s = after.user + after.system - before.user - before.system
    return 100 * used_s / (time.monotonic() - began_s)


def _name(number: int) -> str:
    return f"robot-{number:03}"


class Agent(threading.Thread):
    """A reporter process, and the state file that a cloud agent would write beside it."""

    def __init__(self, folder: Path, kubeconfig: Path) -> None:
        super().__init__(name="agent", daemon=True)
        self._file = folder / "state.json"
        self._log = folder / "reporter.log"
        self._writing = threading.Lock()
        self._message = "as it begins"
        self._number = 0
        self.ended = threading.Event()
        environment = {
            "NAMESPACE": PLACE, "LEASE_NAME": "robot", "ROBOT_NAME": "robot", "STATE_FILE": str(self._file),
            "HANDOVER_FILE": str(folder / "handover"), "HANDOVER_PROOF": "bench", "PORT": "0",
            "KUBECONFIG": str(kubeconfig),
        }  # fmt: skip
        with self._log.open("wb") as log:
            command = [sys.executable, "-m", "robot_offload.reporter"]
            self.process = subprocess.Popen(command, env={**os.environ, **environment}, stderr=log)

    def port(self) -> int:
        """Returns where it serves, as soon as it does."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            found = re.search(r'\["0\.0\.0\.0", (\d+)\]', self._log.read_text(encoding="utf-8"))
            if found:
                return int(found.group(1))
            time.sleep(0.05)
        raise RobotOffloadError(f"the reporter does not serve; see {self._log}")

    def change(self, message: str) -> float:
        """Writes a state with this message at once; returns when, milliseconds of the unix clock."""
        self._message = message
        return self._write()

    def run(self) -> None:
        """Writes five times a second."""
        while not self.ended.wait(BEAT_S):
            self._write()

    def _write(self) -> float:
        with self._writing:
            self._number += 1
            state = {
                "version": 1, "written": str(self._number), "connected": True, "since": "2026-11-23T10:00:00Z",
                "site": "cloud", "epoch": 3, "reason": "LinkGood", "message": self._message, "ready": True,
                "link": {"latency_ms": 12.0 + self._number % 7, "loss_share": 0.01},
                "round_trip_ms": {"p50": 12.0, "p99": 19.0},
                "carried": [{"topic": f"/topic_{n}", "bytes": 1000 * n * self._number} for n in range(10)],
                "nodes": [{"name": f"node_{n}", "state": "active"} for n in range(8)],
            }  # fmt: skip
            new = self._file.with_suffix(".new")
            new.write_text(json.dumps(state), encoding="utf-8")
            at_ms = time.clock_gettime(time.CLOCK_REALTIME) * 1e3
            new.replace(self._file)
            return at_ms


@contextmanager
def _reporter(out: Path, kubeconfig: Path) -> Iterator[Agent]:
    agent = Agent(out, kubeconfig)
    try:
        yield agent
    finally:
        agent.ended.set()
        agent.process.terminate()
        agent.process.wait(30)


async def _make(api: KubeApi, port: int) -> None:
    """Makes the robots, each with a Service that leads to the one reporter."""
    try:
        await api.create({"apiVersion": "v1", "kind": NAMESPACE.kind, "metadata": {"name": PLACE}})
    except AlreadyExistsError:
        return
    address = _own_address()
    pod = {"apiVersion": "v1", "kind": POD.kind, "metadata": {"name": AGENT, "namespace": PLACE}}
    container = {"name": "reporter", "image": "registry.example/operator:1"}
    await api.create({**pod, "spec": {"containers": [container]}})
    # The API server only asks an address that a pod has; no kubelet is here that could say which.
    where = {"phase": "Running", "podIP": address, "podIPs": [{"ip": address}]}
    await api.patch(POD, PLACE, AGENT, {"status": where}, subresource="status")
    for number in range(ROBOTS):
        name = _name(number)
        made = await api.create(_robot_offload(name))
        status = {
            "observedGeneration": made["metadata"]["generation"], "placement": "Cloud", "placementReason": "LinkGood",
            "robot": {"connected": True, "since": "2026-11-23T10:00:00Z"},
        }  # fmt: skip
        await api.patch(ROBOT_OFFLOAD, PLACE, name, {"status": status}, subresource="status")
        service = child_name(name, AGENT)
        metadata = {"name": service, "namespace": PLACE}
        spec = {"ports": [{"port": 8080, "targetPort": port}], "clusterIP": "None"}
        await api.create({"apiVersion": "v1", "kind": SERVICE.kind, "metadata": metadata, "spec": spec})
        await api.create(_endpoints(service, address, port))


def _robot_offload(name: str) -> Manifest:
    node = {
        "name": "talker", "placement": "Duplicated", "core": True, "image": "registry.example/talker:1",
        "run": {"package": "demo_nodes_cpp", "executable": "talker"},
        "outputs": [{"topic": "/chatter", "type": "std_msgs/msg/String", "rate": 10}],
    }  # fmt: skip
    return {
        "apiVersion": ROBOT_OFFLOAD.api_version,
        "kind": ROBOT_OFFLOAD.kind,
        "metadata": {"name": name, "namespace": PLACE},
        "spec": {"nodes": [node]},
    }


def _endpoints(service: str, address: str, port: int) -> Manifest:
    pod = {"kind": POD.kind, "name": AGENT, "namespace": PLACE}
    return {
        "apiVersion": "v1",
        "kind": "Endpoints",
        "metadata": {"name": service, "namespace": PLACE},
        "subsets": [{"addresses": [{"ip": address, "targetRef": pod}], "ports": [{"port": port}]}],
    }


def _own_address() -> str:
    """Returns an address of this machine that is none of the loopback's: endpoints may not be one of those."""
    for addresses in psutil.net_if_addrs().values():
        for each in addresses:
            if each.family is socket.AF_INET and not each.address.startswith("127."):
                return each.address
    raise RobotOffloadError("this machine has no address beside the loopback; the API server passes on to no other")


@contextmanager
def _served(kubeconfig: Path) -> Iterator[tuple[str, psutil.Process]]:
    arguments = ["console", "--no-open", "--kubeconfig", str(kubeconfig), "--namespace", PLACE]
    process = subprocess.Popen([sys.executable, "-m", "robot_offload", *arguments], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line.startswith("Console: "):
            raise RobotOffloadError(f"the console did not start: {line}")
        yield line.split()[1], psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait(30)


@contextmanager
def _browser(program: str) -> Iterator[Any]:
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - a tool of development, as the browser is

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=list(FLAGS))
        yield browser.new_context(viewport={"width": 1280, "height": 900})
        browser.close()
