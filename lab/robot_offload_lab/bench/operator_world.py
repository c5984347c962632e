"""What the operator's bench runs: a control plane, operator processes, robots that renew Leases."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.cluster import programs
from robot_offload_lab.cluster.commands import Helm, Kubectl

PLACE: Final = "bench"
"""The namespace of the objects."""
PATIENCE_S: Final = 120.0
_HOME: Final = "default"
"""The operator's own namespace."""
_CHART: Final = Path(__file__).resolve().parents[3] / "charts" / "robot-offload"
_READS: Final = ("get", "list", "watch")
_LEASE_EVERY_S: Final = 10.0
"""The reporter's period."""


class Operator:
    """One operator process."""

    def __init__(self, kubeconfig: Path, log: Path, source: Path | None, resync_s: float) -> None:
        images = {
            f"{name}_IMAGE": f"registry.example/{name.lower()}:1"
            for name in ("AGENT", "OPERATOR", "DISCOVERY", "ROUTER")
        }
        environment = {
            **os.environ,
            **images,
            "KUBECONFIG": str(kubeconfig),
            "POD_NAMESPACE": _HOME,
            "POD_NAME": "bench",
            "METRICS_PORT": "0",
            "HEALTH_PORT": "0",
            "RESYNC_SECONDS": f"{resync_s:g}",
            **({"PYTHONPATH": str(source)} if source is not None else {}),
        }
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "robot_offload", "operator"], env=environment, stdout=output, stderr=output
            )

    def port(self) -> int:
        """Return the port of /metrics, as soon as it serves."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for line in self._log.read_text(errors="replace").splitlines():
                if '"metrics"' in line and '"Serving"' in line:
                    return int(json.loads(line)["port"])
            if self._process.poll() is not None:
                raise RobotOffloadError(f"the operator ended with {self._process.returncode}; see {self._log}")
            time.sleep(0.05)
        raise RobotOffloadError(f"the operator does not serve; see {self._log}")

    def metrics(self) -> dict[str, float]:
        """Return all metrics by name and labels."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port()}/metrics", timeout=30) as answer:
            lines = answer.read().decode().splitlines()
        return {name: float(value) for name, value in (line.rsplit(" ", 1) for line in lines if line[0] != "#")}

    def requests(self) -> tuple[int, int]:
        """Return the numbers of reads and writes so far."""
        counts = {
            match.group(1): int(value)
            for name, value in self.metrics().items()
            if (match := re.fullmatch(r'robot_offload_requests_total\{verb="(.*)"\}', name))
        }
        reads = sum(counts.get(verb, 0) for verb in _READS)
        return reads, sum(counts.values()) - reads

    def memory_mib(self) -> tuple[float, float]:
        """Return resident memory now and at its highest."""
        text = Path(f"/proc/{self._process.pid}/status").read_text(encoding="utf-8")
        now, peak = (re.search(rf"{name}:\s+(\d+) kB", text) for name in ("VmRSS", "VmHWM"))
        return (int(now.group(1)) / 1024 if now else 0.0, int(peak.group(1)) / 1024 if peak else 0.0)

    def cpu_s(self) -> float:
        """Return the processor time so far, of all its threads."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> None:
        """End it; the next operator may lead at once."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        self._process.wait(60)


@contextmanager
def control_plane(kubeconfig: Path | None) -> Iterator[Path]:
    """Yield the kubeconfig of the given API server, or of a new one that lasts as long as the block."""
    if kubeconfig is not None:
        yield kubeconfig
        return
    command = [sys.executable, "-m", "robot_offload_lab.cluster", "--name", "bench-operator"]
    started = subprocess.run([*command, "up"], capture_output=True, text=True, check=False)
    found = re.search(r"KUBECONFIG=(\S+)", started.stdout + started.stderr)
    if started.returncode or not found:
        raise RobotOffloadError(f"the control plane did not start:\n{started.stdout}{started.stderr}")
    try:
        yield Path(found.group(1))
    finally:
        subprocess.run([*command, "down"], capture_output=True, check=False)


def account(administrator: Path, directory: Path) -> Path:
    """Install the rights that the chart gives the operator; return a kubeconfig with these and no others.

    Args:
        administrator: kubeconfig of a user who may grant rights.
        directory: where the new kubeconfig is written.
    """
    built = programs.ensure(lambda _: None)
    helm = Helm(built.path("helm"), administrator, _HOME)
    kubectl = Kubectl(built.path("kubectl"), administrator, _HOME)
    shown = [part for name in ("serviceaccount", "rbac") for part in ("--show-only", f"templates/{name}.yaml")]
    kubectl("apply", "--server-side", "-f", "-", stdin=helm("template", "robot-offload", str(_CHART), *shown))
    token = kubectl("create", "token", "robot-offload-operator", "--duration=24h").strip()
    config = json.loads(kubectl("config", "view", "--raw", "--minify", "-o", "json"))
    config["users"][0]["user"] = {"token": token}
    path = directory / "account.kubeconfig"
    path.write_text(json.dumps(config))
    return path


@contextmanager
def moving_leases(kubeconfig: Path, objects: int) -> Iterator[None]:
    """Renew the Leases of all robots while the block runs, in a process of its own."""
    command = [sys.executable, "-m", "robot_offload_lab.bench.parts.fleet", str(kubeconfig), PLACE, str(objects)]
    process = subprocess.Popen([*command, str(_LEASE_EVERY_S)]) if objects else None
    try:
        yield
    finally:
        if process is not None:
            process.terminate()
            process.wait(30)
