"""Both discovery servers go at once and return: a node that is made then and those that were there find each other.

The servers are begun by the start script of their image, as the kubelet begins them; the agent is a super client.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.ros.agent.processes import Processes
from tests.ros.agent.routers import library_path
from tests.ros.ports import HOST, free_port

ROOT = Path(__file__).resolve().parents[2]
START = ROOT / "images" / "discovery" / "start"
NODE = Path(__file__).with_name("saying.py")
PATIENCE_S = 60.0


class Servers:
    """Two discovery servers, each with a folder that outlives its process, as the pod's /tmp does."""

    def __init__(self, processes: Processes) -> None:
        self.addresses = [f"{HOST}:{free_port()}" for _ in range(2)]
        self._processes = processes
        self._homes = 0
        self._running = [self._begin(server) for server in range(2)]

    def die_and_return(self) -> None:
        """kill -9 of both, and at once a new process for each."""
        for process in self._running:
            process.kill()
            process.wait(30)
        self._running = [self._begin(server) for server in range(2)]

    def be_replaced(self) -> None:
        """Ends both in order, and begins new ones with empty folders as soon as they have ended, as new pods are."""
        for process in self._running:
            process.terminate()
        assert [process.wait(30) for process in self._running] == [0, 0]
        self._homes += 1
        self._running = [self._begin(server) for server in range(2)]

    def _begin(self, server: int) -> subprocess.Popen[bytes]:
        home = self._processes.folder / f"server-{server}-{self._homes}"
        home.mkdir(exist_ok=True)
        _, _, port = self.addresses[server].partition(":")
        environment = {
            "HOME": str(home),
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "ROS_DISTRO": "of-the-wheels",
            "LD_LIBRARY_PATH": library_path(),
        }
        command = [str(START), "fast-discovery-server", "-i", str(server), "-l", HOST, "-p", port]
        return self._processes.start(f"server-{server}", command, environment=environment)


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    processes = Processes(tmp_path, {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"})
    yield processes
    assert processes.close() == []


@pytest.mark.parametrize("how", [Servers.die_and_return, Servers.be_replaced])
def test_a_node_made_after_all_discovery_servers_went_is_found(
    processes: Processes, how: Callable[[Servers], None]
) -> None:
    servers = Servers(processes)
    found_by = {"ROS_DISCOVERY_SERVER": ";".join(servers.addresses)}

    def node(name: str, says: str, hears: str) -> None:
        agent = {"ROS_SUPER_CLIENT": "TRUE"} if name == "agent" else {}
        processes.start(name, [sys.executable, str(NODE), name, says, hears], environment=found_by | agent)

    def heard(name: str, other: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while f"heard {other}\n" not in processes.log(name):
            assert time.monotonic() < deadline, f"{name} does not hear {other}\n{processes.logs()}"
            time.sleep(0.1)

    node("agent", "to_nodes", "to_agent")
    node("early", "to_agent", "to_nodes")
    heard("agent", "early")
    heard("early", "agent")
    how(servers)
    node("late", "to_agent", "to_nodes")
    heard("agent", "late")
    heard("late", "agent")
