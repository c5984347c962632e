"""`python -m robot_offload_lab.bench.operator_scale`: many RobotOffloads on one real API server.

Starts the test cluster's control plane and one operator process with the rights that the chart gives it, and applies
the objects, a few at a time, some with a parameter file of the size of Nav2's. Then robots report: their Leases move,
as the reporters beside their agents move them. Measured are: how long each object takes until its status reports that
everything is applied, alone and during a resync of all others; how many requests that took, and how many are sent while
nothing changes; the processor time; how long a new operator needs to see all objects, and its memory then. Nothing here
asserts: the table states the aims.
"""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import tempfile
import time
from collections.abc import Sequence
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
from robot_offload_lab.bench.operator_world import PATIENCE_S, PLACE, Operator, account, control_plane, moving_leases

_APPLIED: Final = 'robot_offload_condition{status="True",type="ResourcesApplied"}'
_AT_ONCE: Final = 8
_DURING_RESYNC: Final = 20
_PARAMETERS: Final = 20_000
"""Bytes of a parameter file, as in Nav2's own bring-up."""
_NODES: Final = 8
"""Nodes of Nav2 that read one parameter file."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The figures of one run.

    Attributes:
        objects: how many RobotOffloads.
        cores: cores of this machine.
        load: load of this machine before the start: processes that wanted a core, over a minute.
        settle_p50_s: from the apply to the status Applied, median; some are applied at the same time.
        settle_p99_s: the same, 99th percentile.
        reads_per_object: read requests until everything was quiet.
        writes_per_object: write requests until everything was quiet.
        cpu_per_object_s: processor time of the operator for one new object.
        steady_s: how long only Leases changed, with one resync.
        steady_reads: reads in that time.
        steady_writes: writes in that time, without the leader's Lease.
        steady_cpu_percent: processor time of the operator in that time, in percent of one core.
        resync_p50_s: as `settle_p50_s`, one by one during the resync.
        resync_p99_s: the same, the longest of these.
        restart_s: time until a new operator had looked at every object.
        restart_reads: what it read.
        restart_writes: what it wrote.
        restart_cpu_per_object_s: processor time of the new operator for one object.
        rss_mib: resident memory of the new operator after that.
        peak_rss_mib: the same at its highest.
    """

    objects: int
    cores: int
    load: float
    settle_p50_s: float
    settle_p99_s: float
    reads_per_object: float
    writes_per_object: float
    cpu_per_object_s: float
    steady_s: float
    steady_reads: int
    steady_writes: int
    steady_cpu_percent: float
    resync_p50_s: float
    resync_p99_s: float
    restart_s: float
    restart_reads: int
    restart_writes: int
    restart_cpu_per_object_s: float
    rss_mib: float
    peak_rss_mib: float


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a measurement.

    Attributes:
        objects: how many RobotOffloads.
        nav2: how many of them have eight nodes that read one large parameter file.
        steady_s: seconds in which only Leases move, and the period of the resync.
        leases: whether Leases move.
        source: folder with the package of another operator; None: this one.
    """

    objects: int
    nav2: int
    steady_s: float
    leases: bool
    source: Path | None


def main(
    *,
    objects: Annotated[int, typer.Option(min=1, help="How many RobotOffloads.")] = 200,
    nav2: Annotated[int, typer.Option(min=0, help="How many of them have 8 nodes that share a file of 20 kB.")] = 10,
    steady: Annotated[
        float, typer.Option(min=1, help="Seconds in which only Leases move; also the period of the resync.")
    ] = 60.0,
    leases: Annotated[bool, typer.Option(help="Renew the Leases of all robots every 10 s meanwhile.")] = True,
    source: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder with the package of another operator, to compare.")
    ] = None,
    kubeconfig: Annotated[
        Path | None, typer.Option(metavar="FILE", help="An API server of your own for this. Default: a new one.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Measure the operator with many RobotOffloads."""
    options = Options(objects, nav2, steady, leases, source)
    try:
        with control_plane(kubeconfig) as config, tempfile.TemporaryDirectory() as directory:
            measured = asyncio.run(_measure(config, Path(directory), options))
    except RobotOffloadError as error:
        typer.echo("\n".join(error.lines), err=True)
        raise typer.Exit(error.exit_code) from error
    if as_json:
        typer.echo(json.dumps(asdict(measured), indent=2))
    else:
        _show(measured)


async def _measure(kubeconfig: Path, directory: Path, options: Options) -> Measured:
    api, objects, load = connect(str(kubeconfig)), options.objects, os.getloadavg()[0]
    rights = account(kubeconfig, directory)
    operator = Operator(rights, directory / "first.log", options.source, options.steady_s)
    try:
        operator.port()
        await _make_place(api)
        waits = await _settle_all(api, options)
        reads, writes = await _quiet(operator)
        cpu_s = operator.cpu_s()
        with moving_leases(kubeconfig, objects if options.leases else 0):
            # The resync begins one period after the start and is spread over the next one.
            await asyncio.sleep(options.steady_s)
            steady_reads, steady_writes = operator.requests()
            steady_cpu_s = operator.cpu_s() - cpu_s
            late = [await _settle(api, _walker(f"late-{number}")) for number in range(_DURING_RESYNC)]
            operator.stop()
            began = time.monotonic()
            operator = Operator(rights, directory / "second.log", options.source, options.steady_s)
            await _until(lambda: operator.metrics().get(_APPLIED, 0) >= objects + _DURING_RESYNC)
            restart_s = time.monotonic() - began
            restart_reads, restart_writes = await _quiet(operator)
        restart_cpu_s, (now, peak) = operator.cpu_s(), operator.memory_mib()
    finally:
        operator.stop()
        await api.close()
    return Measured(
        objects=objects,
        cores=os.cpu_count() or 1,
        load=load,
        settle_p50_s=statistics.median(waits),
        settle_p99_s=_p99(waits),
        reads_per_object=reads / objects,
        writes_per_object=writes / objects,
        cpu_per_object_s=cpu_s / objects,
        steady_s=options.steady_s,
        steady_reads=steady_reads - reads,
        steady_writes=steady_writes - writes,
        steady_cpu_percent=100 * steady_cpu_s / options.steady_s,
        resync_p50_s=statistics.median(late),
        resync_p99_s=_p99(late),
        restart_s=restart_s,
        restart_reads=restart_reads,
        restart_writes=restart_writes,
        restart_cpu_per_object_s=restart_cpu_s / (objects + _DURING_RESYNC),
        rss_mib=now,
        peak_rss_mib=peak,
    )


def _p99(values: Sequence[float]) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))]


async def _settle_all(api: KubeApi, options: Options) -> list[float]:
    """Apply all objects, a few at once; return the seconds that each took."""
    names = iter(range(options.objects))

    async def one_after_the_other() -> list[float]:
        return [
            await _settle(api, _nav2(f"robot-{number}") if number < options.nav2 else _walker(f"robot-{number}"))
            for number in names
        ]

    config = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "nav2", "namespace": PLACE}}
    await api.create({**config, "data": {"nav2.yaml": _parameters()}})
    found = await asyncio.gather(*(one_after_the_other() for _ in range(_AT_ONCE)))
    return [wait for waits in found for wait in waits]


async def _make_place(api: KubeApi) -> None:
    manifest = {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": PLACE}}
    try:
        await api.create(manifest)
    except AlreadyExistsError:
        raise RobotOffloadError(f"the {NAMESPACE.kind} {PLACE} exists; delete it or use another API server") from None


async def _settle(api: KubeApi, manifest: Manifest) -> float:
    """Apply one object and wait for its status; return the seconds it took."""
    began, name = time.monotonic(), manifest["metadata"]["name"]
    await api.create(manifest)
    while time.monotonic() - began < PATIENCE_S:
        if _applied(await api.get(ROBOT_OFFLOAD, PLACE, name)):
            return time.monotonic() - began
        await asyncio.sleep(0.05)
    raise RobotOffloadError(f"{name} was not applied within {PATIENCE_S:g} s")


def _applied(offload: Manifest | None) -> bool:
    conditions = ((offload or {}).get("status") or {}).get("conditions") or ()
    return any(found["type"] == "ResourcesApplied" and found["status"] == "True" for found in conditions)


async def _quiet(operator: Operator) -> tuple[int, int]:
    """Wait until no request has come for some seconds; return the numbers of reads and writes."""
    last, calm = operator.requests(), 0
    while calm < 5:
        await asyncio.sleep(1.0)
        now = operator.requests()
        calm = calm + 1 if now == last else 0
        last = now
    return last


async def _until(happened: Any) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        if time.monotonic() > deadline:
            raise RobotOffloadError("the new operator did not get through all objects in time")
        # Working out the metrics of thousands of objects takes the operator itself tens of milliseconds.
        await asyncio.sleep(0.5)


def _walker(name: str) -> Manifest:
    node: Manifest = {
        "name": "talker",
        "placement": "Duplicated",
        "core": True,
        "image": "registry.example/talker:1",
        "run": {"package": "demo_nodes_cpp", "executable": "talker"},
        "outputs": [{"topic": "/chatter", "type": "std_msgs/msg/String", "rate": 10}],
    }
    return _offload(name, [node])


def _nav2(name: str) -> Manifest:
    """Return a robot whose nodes all read one large parameter file."""
    run = {
        "package": "nav2_nodes",
        "executable": "node",
        "parametersFrom": {"configMapKeyRef": {"name": "nav2", "key": "nav2.yaml"}},
    }
    image = "registry.example/nav2:1"
    nodes = [
        {"name": f"node_{number}", "placement": "Duplicated", "image": image, "run": run} for number in range(_NODES)
    ]
    return _offload(name, nodes)


def _offload(name: str, nodes: list[Manifest]) -> Manifest:
    return {
        "apiVersion": ROBOT_OFFLOAD.api_version,
        "kind": ROBOT_OFFLOAD.kind,
        "metadata": {"name": name, "namespace": PLACE},
        # Not LoadBalancer: a cluster has some 2,700 node ports, and each LoadBalancer takes four.
        "spec": {"nodes": nodes, "transport": {"type": "Zenoh", "expose": {"type": "ClusterIP"}}},
    }


def _parameters() -> str:
    """Return a parameter file of the size of Nav2's."""
    lines = [f"    controller.critic_{number}.weight: {number / 7:.6f}\n" for number in range(60)]
    nodes = [f"node_{number}:\n  ros__parameters:\n" + "".join(lines) for number in range(_NODES)]
    text = "".join(nodes)
    return text + "#" * max(0, _PARAMETERS - len(text))


def _show(measured: Measured) -> None:
    table = Table(title=f"The operator with {measured.objects} RobotOffloads on a real API server")
    for column in ("what", "measured", "aim"):
        table.add_column(column, justify="left" if column == "what" else "right")
    steady = f"in {measured.steady_s:.0f} s in which only Leases move"
    rows = (
        ("cores of this machine, processes that wanted one before", f"{measured.cores}, {measured.load:.1f}", ""),
        (f"applied after, {_AT_ONCE} at once, median", f"{measured.settle_p50_s:.2f} s", ""),
        (f"applied after, {_AT_ONCE} at once, p99", f"{measured.settle_p99_s:.2f} s", ""),
        ("reads per new object", f"{measured.reads_per_object:.0f}", ""),
        ("writes per new object", f"{measured.writes_per_object:.1f}", ""),
        ("processor time per new object", f"{measured.cpu_per_object_s * 1000:.0f} ms", ""),
        (f"reads {steady}", str(measured.steady_reads), "some lists"),
        (f"writes {steady}", str(measured.steady_writes), "robots that connect"),
        (f"processor time {steady}", f"{measured.steady_cpu_percent:.1f} %", ""),
        ("applied after, during a resync, median", f"{measured.resync_p50_s:.2f} s", ""),
        (f"applied after, during a resync, longest of {_DURING_RESYNC}", f"{measured.resync_p99_s:.2f} s", "under 2 s"),
        ("a new operator has seen all after", f"{measured.restart_s:.1f} s", ""),
        ("and has read", str(measured.restart_reads), ""),
        ("and has written", str(measured.restart_writes), "0"),
        ("and needed per object", f"{measured.restart_cpu_per_object_s * 1000:.0f} ms", ""),
        ("its resident memory (peak)", f"{measured.rss_mib:.0f} MiB ({measured.peak_rss_mib:.0f})", "under 512 MiB"),
    )
    for row in rows:
        table.add_row(*row)
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
