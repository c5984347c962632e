"""The real collector process in the real robot's agent, without a cloud: sizes and rates in front of it."""

from __future__ import annotations

import dataclasses
import datetime
import secrets
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.render import ros_names
from robot_offload_lab.bench.analysis import collector
from robot_offload_lab.bench.analysis.collector import Load, Passed
from robot_offload_lab.bench.plan import Amounts, Order
from robot_offload_lab.bench.results import GroupResult
from robot_offload_lab.bench.stage import Stage
from robot_offload_lab.run.certificates import make_certificates
from robot_offload_lab.run.free import HOST, free_domains, free_ports
from robot_offload_lab.run.system import Mode, System, agent, environment
from robot_offload_lab.wire.options import LinkOptions

LARGE: Final = "LARGE_DATA?max_msg_size=2MB&sockets_size=4MB"
LARGE_WORDS: Final = "LARGE_DATA transports"
LOADS: Final = (
    Load(64, 50.0),
    Load(64, 200.0),
    Load(64, 500.0),
    Load(1 << 10, 50.0),
    Load(1 << 14, 50.0),
    Load(1 << 16, 20.0),
    Load(1 << 18, 20.0),
    Load(1 << 20, 10.0),
)
LARGE_LOADS: Final = (Load(1 << 18, 20.0, LARGE_WORDS), Load(1 << 20, 10.0, LARGE_WORDS))
"""Above the 512 KB of its shared memory Fast DDS needs other transports, on every participant of the robot."""
NODE: Final = "burst"
SINK: Final = "sink"
SETTLE_S: Final = 1.5
LANDING_S: Final = 0.3


def steps(_amounts: Amounts) -> float:
    """For the progress bar."""
    return len(LOADS) + len(LARGE_LOADS)


def run(order: Order) -> GroupResult:
    """Measures all loads with the default transports, then the large ones with those that are made for them."""
    found = _measure(order, "collector", LOADS, {})
    found += _measure(order, "collector-large", LARGE_LOADS, {"FASTDDS_BUILTIN_TRANSPORTS": LARGE})
    return collector.outcome(order.priority, found)


def _measure(order: Order, name: str, loads: Sequence[Load], extra: dict[str, str]) -> list[Passed]:
    domains = order.domains or free_domains()
    with (
        TemporaryDirectory(prefix="ro-") as temporary,
        Stage(order.folder(name), realtime=order.realtime, domain=domains[0]) as stage,
    ):
        system = _system(order, stage.folder, Path(temporary), domains)
        _start(stage, system, extra)
        stage.until(lambda: {"active": True} in stage.said[NODE], "the agent activates the node")
        stage.rest(SETTLE_S)
        found = []
        for number, load in enumerate(loads):
            found.append(_stage(stage, number, load, order.amounts.stage_s))
            order.advance(1)
    return found


def _stage(stage: Stage, number: int, load: Load, seconds: float) -> Passed:
    command = {"stage": number, "bytes": load.size, "rate_hz": load.rate_hz, "seconds": seconds}
    sent = stage.ask(NODE, command, f"{load.title} is published", seconds * 5 + 30)
    stage.rest(LANDING_S)
    came = stage.ask(SINK, {"stage": number}, "the consumer reports what came")
    took_s = seconds + sent["behind_ms"] / 1e3
    return Passed(load, sent["sent"], took_s, tuple(came["collected"]), tuple(came["direct"]))


def _system(order: Order, folder: Path, temporary: Path, domains: tuple[int, int]) -> System:
    dialled, served = free_ports()
    (folder / "logs" / "ros").mkdir(parents=True, exist_ok=True)
    return System(
        offload=offload(), source=folder, mode=Mode.ROBOT_ONLY, run=secrets.token_hex(8), out=folder,
        temporary=temporary, domains=domains, link=LinkOptions(), seed=order.seed, realtime=order.realtime,
        dialled=dialled, served=served,
    )  # fmt: skip


def _start(stage: Stage, system: System, extra: dict[str, str]) -> None:
    """Starts the robot's agent, its node, and the consumer."""
    stage.start(SINK, "robot_offload_lab.bench.parts.sink", extra=extra)
    now = datetime.datetime.now(tz=datetime.UTC)
    certificates = make_certificates(
        system.certificates, robot=system.offload.metadata.name, host_names=[HOST], now=now
    )
    program = agent(system, "robot", certificates)
    stage.programs.start(dataclasses.replace(program, environment={**environment(system, "robot"), **extra}))
    spec = system.spec
    words = ros_names.command(spec, spec.nodes[0], "robot")[3:]  # after `python3 -m MODULE`
    stage.start(NODE, "robot_offload_lab.bench.parts.burst", *words, extra=extra)


def offload() -> RobotOffload:
    """Returns one node with one collected output, held on the robot."""
    document: dict[str, Any] = {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": "bench"},
        "spec": {
            "nodes": [
                {
                    "name": NODE,
                    "placement": "Duplicated",
                    "run": {"command": ["python3", "-m", "robot_offload_lab.bench.parts.burst"]},
                    "outputs": [{"topic": "/bench/command", "type": "std_msgs/msg/UInt8MultiArray"}],
                }
            ],
            "switching": {"pin": "Robot"},
        },
    }
    return parse_object(document, "the collector's bench")
