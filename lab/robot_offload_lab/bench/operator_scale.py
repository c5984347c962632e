"""`python -m robot_offload_lab.bench.operator_scale`: many RobotOffloads on one real API server.

Starts the test cluster's control plane and one operator process, applies the objects one by one, and measures: how long
each takes until its status says that everything is applied, how many requests it took, what is written while nothing
changes, how long a new operator needs to look at everything, and the operator's memory. Nothing here asserts: the table
says what was aimed at.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table

from robot_offload.errors import RobotOffloadError
from robot_offload.kube.configuration import connect
from robot_offload.kube.errors import AlreadyExistsError
from robot_offload.kube.kinds import NAMESPACE, ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest

PLACE: Final = "bench"
_PATIENCE_S: Final = 120.0
_APPLIED: Final = 'robot_offload_condition{status="True",type="ResourcesApplied"}'
_READS: Final = ("get", "list")


@dataclass(frozen=True, slots=True)
class Measured:
    """The figures of one run.

    Attributes:
        objects: how many RobotOffloads.
        settle_p50_s: from the apply to the status that says Applied, median.
        settle_p99_s: the same, what one of a hundred exceeds.
        reads_per_object: requests that read, until everything was quiet.
        writes_per_object: requests that write, until everything was quiet.
        steady_s: for how long nothing changed.
        steady_writes: writes in that time, without the leader's Lease.
        steady_writes_per_hour: the same, for an hour.
        steady_reads_per_object_per_hour: reads in that time, for an hour.
        restart_s: until a new operator had looked at every object.
        restart_writes: what it wrote.
        rss_mib: the operator's resident memory after all that.
        peak_rss_mib: at its highest.
    """

    objects: int
    settle_p50_s: float
    settle_p99_s: float
    reads_per_object: float
    writes_per_object: float
    steady_s: float
    steady_writes: int
    steady_writes_per_hour: float
    steady_reads_per_object_per_hour: float
    restart_s: float
    restart_writes: int
    rss_mib: float
    peak_rss_mib: float


class _Operator:
    """One operator process."""

    def __init__(self, kubeconfig: Path, log: Path) -> None:
        images = {
            f"{name}_IMAGE": f"registry.example/{name.lower()}:1"
            for name in ("AGENT", "OPERATOR", "DISCOVERY", "ROUTER")
        }
        environment = {
            **os.environ,
            **images,
            "KUBECONFIG": str(kubeconfig),
            "POD_NAMESPACE": "default",
            "POD_NAME": "bench",
            "METRICS_PORT": "0",
            "HEALTH_PORT": "0",
        }
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "robot_offload.process.main"], env=environment, stdout=output, stderr=output
            )

    def port(self) -> int:
        """Of /metrics, as soon as it serves."""
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            for line in self._log.read_text(errors="replace").splitlines():
                if '"metrics"' in line and '"Serving"' in line:
                    return int(json.loads(line)["port"])
            if self._process.poll() is not None:
                raise RobotOffloadError(f"the operator ended with {self._process.returncode}; see {self._log}")
            time.sleep(0.05)
        raise RobotOffloadError(f"the operator does not serve; see {self._log}")

    def metrics(self) -> dict[str, float]:
        """Returns all metrics by name and labels."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port()}/metrics", timeout=30) as answer:
            lines = answer.read().decode().splitlines()
        return {name: float(value) for name, value in (line.rsplit(" ", 1) for line in lines if line[0] != "#")}

    def requests(self) -> tuple[int, int]:
        """Reads and writes so far."""
        counts = {
            match.group(1): int(value)
            for name, value in self.metrics().items()
            if (match := re.fullmatch(r'robot_offload_requests_total\{verb="(.*)"\}', name))
        }
        reads = sum(counts.get(verb, 0) for verb in _READS)
        return reads, sum(counts.values()) - reads

    def memory_mib(self) -> tuple[float, float]:
        """Resident memory now and at its highest."""
        text = Path(f"/proc/{self._process.pid}/status").read_text(encoding="utf-8")
        now, peak = (re.search(rf"{name}:\s+(\d+) kB", text) for name in ("VmRSS", "VmHWM"))
        return (int(now.group(1)) / 1024 if now else 0.0, int(peak.group(1)) / 1024 if peak else 0.0)

    def stop(self) -> None:
        """Ends it; the next one may lead at once."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        self._process.wait(60)


def main(
    *,
    objects: Annotated[int, typer.Option(min=1, help="How many RobotOffloads.")] = 200,
    steady: Annotated[float, typer.Option(min=1, help="Seconds without any change.")] = 60.0,
    kubeconfig: Annotated[
        Path | None, typer.Option(metavar="FILE", help="An API server of your own for this. Default: a new one.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Measure the operator with many RobotOffloads."""
    try:
        with _control_plane(kubeconfig) as config, tempfile.TemporaryDirectory() as directory:
            measured = asyncio.run(_measure(config, Path(directory), objects, steady))
    except RobotOffloadError as error:
        typer.echo("\n".join(error.lines), err=True)
        raise typer.Exit(error.exit_code) from error
    if as_json:
        typer.echo(json.dumps(asdict(measured), indent=2))
    else:
        _show(measured)


@contextmanager
def _control_plane(kubeconfig: Path | None) -> Iterator[Path]:
    """Yields the kubeconfig of the given API server, or of a new one that lasts as long as the block."""
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


async def _measure(kubeconfig: Path, directory: Path, objects: int, steady_s: float) -> Measured:
    api = connect(str(kubeconfig))
    operator = _Operator(kubeconfig, directory / "first.log")
    try:
        operator.port()
        await _make_place(api)
        waits = [await _settle(api, f"robot-{number}") for number in range(objects)]
        reads, writes = await _quiet(operator)
        await asyncio.sleep(steady_s)
        steady_reads, steady_writes = operator.requests()
        now, peak = operator.memory_mib()
        operator.stop()
        began = time.monotonic()
        operator = _Operator(kubeconfig, directory / "second.log")
        await _until(lambda: operator.metrics().get(_APPLIED, 0) >= objects)
        restart_s = time.monotonic() - began
        _, restart_writes = await _quiet(operator)
    finally:
        operator.stop()
        await api.close()
    ordered = sorted(waits)
    return Measured(
        objects=objects,
        settle_p50_s=statistics.median(ordered),
        settle_p99_s=ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))],
        reads_per_object=reads / objects,
        writes_per_object=writes / objects,
        steady_s=steady_s,
        steady_writes=steady_writes - writes,
        steady_writes_per_hour=(steady_writes - writes) * 3600 / steady_s,
        steady_reads_per_object_per_hour=(steady_reads - reads) * 3600 / steady_s / objects,
        restart_s=restart_s,
        restart_writes=restart_writes,
        rss_mib=now,
        peak_rss_mib=peak,
    )


async def _make_place(api: KubeApi) -> None:
    manifest = {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": PLACE}}
    try:
        await api.create(manifest)
    except AlreadyExistsError:
        raise RobotOffloadError(f"the {NAMESPACE.kind} {PLACE} exists; delete it or use another API server") from None


async def _settle(api: KubeApi, name: str) -> float:
    """Applies one object and waits for its status; returns the seconds it took."""
    began = time.monotonic()
    await api.create(_walker(name))
    while time.monotonic() - began < _PATIENCE_S:
        if _applied(await api.get(ROBOT_OFFLOAD, PLACE, name)):
            return time.monotonic() - began
        await asyncio.sleep(0.02)
    raise RobotOffloadError(f"{name} was not applied within {_PATIENCE_S:g} s")


def _applied(offload: Manifest | None) -> bool:
    conditions = ((offload or {}).get("status") or {}).get("conditions") or ()
    return any(found["type"] == "ResourcesApplied" and found["status"] == "True" for found in conditions)


async def _quiet(operator: _Operator) -> tuple[int, int]:
    """Reads and writes, once no request has come for some seconds."""
    last, calm = operator.requests(), 0
    while calm < 5:
        await asyncio.sleep(1.0)
        now = operator.requests()
        calm = calm + 1 if now == last else 0
        last = now
    return last


async def _until(happened: Any) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    while not happened():
        if time.monotonic() > deadline:
            raise RobotOffloadError("the new operator did not get through all objects in time")
        await asyncio.sleep(0.1)


def _walker(name: str) -> Manifest:
    node: Mapping[str, Any] = {
        "name": "talker",
        "placement": "Duplicated",
        "core": True,
        "image": "registry.example/talker:1",
        "run": {"package": "demo_nodes_cpp", "executable": "talker"},
        "outputs": [{"topic": "/chatter", "type": "std_msgs/msg/String", "rate": 10}],
    }
    return {
        "apiVersion": ROBOT_OFFLOAD.api_version,
        "kind": ROBOT_OFFLOAD.kind,
        "metadata": {"name": name, "namespace": PLACE},
        "spec": {"nodes": [node]},
    }


def _megabytes(mebibytes: float) -> int:
    """Returns whole MB (10^6 bytes) of MiB (2^20 bytes): the aim is in MB, the kernel counts in KiB."""
    return round(mebibytes * 1024 * 1024 / 1e6)


def _show(measured: Measured) -> None:
    """Prints the table."""
    table = Table(title=f"The operator with {measured.objects} RobotOffloads on a real API server")
    for column in ("what", "measured", "aim"):
        table.add_column(column, justify="left" if column == "what" else "right")
    rows = (
        ("applied after, median", f"{measured.settle_p50_s:.2f} s", ""),
        ("applied after, p99", f"{measured.settle_p99_s:.2f} s", "under 2 s"),
        ("reads per object until quiet", f"{measured.reads_per_object:.0f}", ""),
        ("writes per object until quiet", f"{measured.writes_per_object:.1f}", ""),
        (f"writes in {measured.steady_s:.0f} s without change", str(measured.steady_writes), "0"),
        ("reads per object and hour without change", f"{measured.steady_reads_per_object_per_hour:.0f}", ""),
        ("a new operator has seen all after", f"{measured.restart_s:.1f} s", ""),
        ("and has written", str(measured.restart_writes), "0"),
        (
            "resident memory (peak)",
            f"{_megabytes(measured.rss_mib)} MB ({_megabytes(measured.peak_rss_mib)})",
            "under 120 MB",
        ),
    )
    for row in rows:
        table.add_row(*row)
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
