"""The operator as a process: started, killed, stopped, and asked."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from tests.integration.operator_cluster import eventually

ROOT = Path(__file__).resolve().parents[2]
IMAGES = {
    "AGENT_IMAGE": "registry.example/agent:1",
    "OPERATOR_IMAGE": "registry.example/operator:1",
    "DISCOVERY_IMAGE": "registry.example/discovery:1",
    "ROUTER_IMAGE": "registry.example/router:1",
    "GIT_IMAGE": "registry.example/git:1",
}
# Everything that waits is quicker here than in a cluster; nothing else differs.
QUICK = {
    "RESYNC_SECONDS": "600",
    "PROBE_SECONDS": "600",
    "LEADER_LEASE_SECONDS": "15",
    "METRICS_PORT": "0",
    "HEALTH_PORT": "0",
    "LOG_LEVEL": "info",
    "AUTHORITY_KEEP_DAYS": "0",
}


def environment(kubeconfig: Path, name: str, more: Mapping[str, str] | None = None) -> dict[str, str]:
    """The environment of one operator."""
    return {
        **{key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ},
        **IMAGES,
        **QUICK,
        "KUBECONFIG": str(kubeconfig),
        "POD_NAMESPACE": "default",
        "POD_NAME": name,
        "PYTHONWARNINGS": "default",
        **(more or {}),
    }


class Operator:
    """One operator process with its log."""

    def __init__(self, log: Path, begin: Callable[[], Child]) -> None:
        self.log = log
        self._begin = begin
        self._child = begin()

    @classmethod
    def start(cls, kubeconfig: Path, log: Path, name: str = "operator-0", **more: str) -> Operator:
        """Start `python -m robot_offload.handlers`."""

        def begin() -> Child:
            with log.open("ab") as output:
                return subprocess.Popen(
                    [sys.executable, "-m", "robot_offload.handlers"],
                    env=environment(kubeconfig, name, more),
                    cwd=ROOT,
                    stdout=output,
                    stderr=output,
                )

        return cls(log, begin)

    @property
    def pid(self) -> int:
        return self._child.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._child.poll()

    def kill(self) -> None:
        """SIGKILL: no chance to tidy up."""
        self._end(signal.SIGKILL)

    def stop(self) -> int:
        """SIGTERM; returns the exit code."""
        return self._end(signal.SIGTERM)

    def restart(self) -> None:
        """Stop it, start it again, and wait until it leads."""
        leaderships = len(self.said("Became leader"))
        self.stop()
        self._child = self._begin()
        eventually(lambda: len(self.said("Became leader")) > leaderships, "the new operator to lead")

    def _end(self, number: signal.Signals) -> int:
        if self._child.poll() is None:
            os.kill(self._child.pid, number)
        eventually(lambda: self._child.poll() is not None, f"the operator to end: {self.log}")
        code = self._child.poll()
        assert code is not None
        return code

    def lines(self) -> list[dict[str, Any]]:
        """The log so far; what is not JSON (a warning of Python) stands under `text`."""
        found = []
        for line in self.log.read_text(errors="replace").splitlines():
            try:
                found.append(json.loads(line))
            except ValueError:
                found.append({"event": "", "text": line})
        return found

    def said(self, event: str, **fields: Any) -> list[dict[str, Any]]:
        """The lines of the log with this event and these fields."""
        return [line for line in self.lines() if line["event"] == event and fields.items() <= line.items()]

    def wait_said(self, event: str, **fields: Any) -> dict[str, Any]:
        return eventually(lambda: self.said(event, **fields), f"the operator to say {event!r}: {self.log}")[-1]

    def ask(self, what: str, path: str) -> tuple[int, str]:
        """GET one of its own servers: `metrics` or `health`."""
        port = self.wait_said("Serving", what=what)["port"]
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=60) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read().decode()


class Child(Protocol):
    """A process that can be asked whether it has ended."""

    @property
    def pid(self) -> int: ...

    def poll(self) -> int | None: ...


class _Forked:
    """A child of the nursery: only its parent can ask for its exit code."""

    def __init__(self, nursery: Nursery, pid: int) -> None:
        self.pid = pid
        self._nursery = nursery
        self._code: int | None = None

    def poll(self) -> int | None:
        if self._code is None:
            answer = self._nursery.ask({"poll": self.pid}).strip()
            self._code = None if answer == "running" else int(answer)
        return self._code


class Nursery:
    """Operators that start in a moment: one process has imported everything and forks them.

    For tests that kill an operator dozens of times. What is forked runs `running.main` from its first line.
    """

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("operator_nursery.py"))],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def start(self, kubeconfig: Path, log: Path, name: str = "operator-0", **more: str) -> Operator:
        """Start an operator."""
        log.touch()  # whoever reads the log may be faster than the fork
        order = {"log": str(log), "environment": environment(kubeconfig, name, more)}
        return Operator(log, lambda: _Forked(self, int(self.ask(order))))

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(60)
        assert self._process.stdout is not None
        self._process.stdout.close()

    def ask(self, order: Mapping[str, Any]) -> str:
        """Send an order; returns the answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        assert answer, "the nursery has died"
        return answer
