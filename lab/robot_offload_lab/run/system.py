"""The two sides of a RobotOffload on one machine: which programs run, with which configuration, ports and domains.

The sides are as separate as two machines: processes and ROS domains of their own, joined only by the agents' link
through the emulated wire on loopback. The robot dials the wire's ports, the cloud listens on others.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Final

from robot_offload.api.v1alpha1 import Node, RobotOffload, RobotOffloadSpec, Run
from robot_offload.api.v1alpha1.names import Side
from robot_offload.errors import InputError
from robot_offload.render import ros_names
from robot_offload.render.agent_config import AgentSite, agent_config
from robot_offload_lab.judge.recording import RunInfo, of_run, silent_at_times
from robot_offload_lab.run import packages, routed
from robot_offload_lab.run.certificates import CertificatePaths, make_certificates
from robot_offload_lab.run.free import HOST
from robot_offload_lab.run.processes import Program
from robot_offload_lab.run.showcase import FILE, Showcase
from robot_offload_lab.wire.dds_options import DdsWireConfig, carried
from robot_offload_lab.wire.options import Forward, LinkOptions, WireConfig
from robot_offload_lab.wire.process import REALTIME_PRIORITY

RECORDER: Final = "recorder"
MCAP: Final = "mcap"
DDS_WIRE: Final = "dds-wire"
NODE_PRIORITY: Final = 3
RECORDER_PRIORITY: Final = 4
"""Both below the agents' own (5 and 10), so that observers and observed nodes never hold up the agents."""


class Mode(StrEnum):
    """Which sides run: both; no cloud side at all; no replicas on the robot."""

    OFFLOAD = "offload"
    ROBOT_ONLY = "robot-only"
    CLOUD_ONLY = "cloud-only"


_FOREIGN: Final = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE",
                   "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_ENVIRONMENT_FILE", "CYCLONEDDS_URI")  # fmt: skip
"""Variables of the caller that would join or separate the sides."""


@dataclass(frozen=True)
class System:
    """One run's two sides.

    Attributes:
        offload: the resource, already changed for the mode.
        source: folder of the specification; commands are relative to it.
        mode: see Mode.
        run: name of the run, unique on this machine.
        out: folder for everything that is kept.
        temporary: folder for sockets; short, because the kernel allows them 107 bytes.
        domains: ROS_DOMAIN_ID of the robot's and of the cloud's side.
        link: what the wire does.
        seed: of everything random.
        realtime: whether everything runs under real-time priority, where that is permitted.
        said: what the example states about itself: topics of its reports, processes that nodes share.
        interfaces: where the interface packages that the nodes need were made.
        dialled, served: ports of pulse and data session, as the robot dials and the cloud serves them.
        cloud_host: where the cloud listens.
        state_file: where the cloud's agent writes its state for a console; empty: nowhere.
    """

    offload: RobotOffload
    source: Path
    mode: Mode
    run: str
    out: Path
    temporary: Path
    domains: tuple[int, int]
    link: LinkOptions
    seed: int
    realtime: bool
    dialled: tuple[int, int]
    served: tuple[int, int]
    said: Showcase = field(default_factory=Showcase)
    cloud_host: str = HOST
    interfaces: tuple[Path, ...] = ()
    state_file: str = ""

    @property
    def settings_file(self) -> str:
        """File from which the cloud's agent reads changes made on a console's page; empty: there is no console."""
        return f"{self.state_file}.settings.yaml" if self.state_file and self.mode is Mode.OFFLOAD else ""

    @property
    def uid(self) -> str:
        """The identity of both agents. A host has one agent of each side, but may have several runs."""
        return f"{self.offload.metadata.name[:40]}-{self.run}"

    @property
    def spec(self) -> RobotOffloadSpec:
        """The specification."""
        return self.offload.spec

    @property
    def sides(self) -> tuple[Side, ...]:
        """The sides that run."""
        return ("robot",) if self.mode is Mode.ROBOT_ONLY else ("cloud", "robot")

    @property
    def outputs(self) -> dict[str, str]:
        """The collected outputs except the reports, with types; an empty type is read from the running system."""
        accounts = self.said.accounts.values()
        outputs = [output for _, output in self.spec.collected_outputs if output.topic not in accounts]
        return {output.topic: output.type or "" for output in outputs}

    @property
    def awaited(self) -> tuple[str, ...]:
        """The outputs that are published all the time: those with a rate and without a condition."""
        return tuple(topic for topic in self.outputs if topic not in silent_at_times(self.spec))

    @property
    def managed_on_robot(self) -> tuple[str, ...]:
        """The lifecycle nodes that run on the robot."""
        return tuple(node.name for node in self.runs_on("robot") if node.lifecycle)

    @property
    def wired(self) -> bool:
        """Whether there is a link to emulate."""
        return self.mode is not Mode.ROBOT_ONLY

    def runs_on(self, side: Side) -> tuple[Node, ...]:
        """Return the nodes that this run starts on a side."""
        bare = self.mode is Mode.CLOUD_ONLY and side == "robot"
        return tuple(node for node in ros_names.nodes_on(self.spec, side) if not (bare and node.duplicated))

    @property
    def joined_by_topics(self) -> bool:
        """Whether the link between the agents is made of ROS topics."""
        return self.wired and self.spec.transport.agent_link == "ros"

    @property
    def routed(self) -> bool:
        """Whether real DDS Routers join the sides, so that their tunnel goes through the emulated link."""
        return self.joined_by_topics and self.spec.transport.type == "DDSRouter" and bool(routed.binary())

    @property
    def joined_by_dds_wire(self) -> bool:
        """Whether the emulated link for DDS carries the topics."""
        return self.joined_by_topics and not self.routed

    @property
    def logs(self) -> Path:
        """The folder of all logs."""
        return self.out / "logs"

    @property
    def certificates(self) -> Path:
        """The folder of the certificates made for the run."""
        return self.out / "certificates"

    @property
    def recording(self) -> Path:
        """The recorder's file."""
        return self.out / "recording.jsonl"

    @property
    def mcap(self) -> Path:
        """The recording for Foxglove, Lichtblick, PlotJuggler and rosbag2."""
        return self.out / "run.mcap"


def adapted(offload: RobotOffload, mode: Mode, seed: int, transport: str = "") -> RobotOffload:
    """Return the resource as this run needs it.

    Args:
        offload: the resource as the user wrote it.
        mode: robot-only and cloud-only pin the placement.
        seed: replaces the parameter `seed` of every node that has one.
        transport: a transport type instead of the specification's; empty: the specification's.
    """
    spec = offload.spec
    switching = spec.switching
    if mode is not Mode.OFFLOAD:
        switching = switching.model_copy(update={"pin": "Robot" if mode is Mode.ROBOT_ONLY else "Cloud"})
    changes: dict[str, object] = {"switching": switching, "nodes": tuple(_seeded(node, seed) for node in spec.nodes)}
    if transport:
        changes["transport"] = spec.transport.model_copy(update={"type": transport})
    return offload.model_copy(update={"spec": spec.model_copy(update=changes)})


def _seeded(node: Node, seed: int) -> Node:
    if node.run is None or "seed" not in node.run.parameters:
        return node
    run = node.run.model_copy(update={"parameters": {**node.run.parameters, "seed": seed}})
    return node.model_copy(update={"run": run})


def check_runnable(offload: RobotOffload, file: Path, said: Showcase | None = None) -> None:
    """Check that everything that the run needs can be started; `said` is what the example states about itself.

    Raises:
        NotRunnableError: has a line for each node that cannot be started.
    """
    sharing = {name for shared in (said.processes if said else ()) for name in shared.nodes}
    unknown = sharing - {node.name for node in offload.spec.nodes}
    problems = [f"{file.parent / FILE}: processes: {name!r} is no node of {file.name}" for name in sorted(unknown)]
    for index, node in enumerate(offload.spec.nodes):
        path = f"{file}: spec.nodes[{index}].run"
        if node.name in sharing:
            continue
        if node.run is None:
            problems.append(f"{path}: nothing says how to start {node.name!r}; write a command")
        elif not node.run.command:
            problems += [f"{path}: {problem}" for problem in _not_installed(node.run)]
        if node.run is not None and node.run.parameters_from is not None:
            problems.append(f"{path}.parametersFrom: there are no ConfigMaps without a cluster; use parameters")
    if problems:
        raise NotRunnableError(problems)


def _not_installed(run: Run) -> Iterator[str]:
    try:
        _executable(run)
    except packages.NotInstalledError as error:
        yield str(error)


class NotRunnableError(InputError):
    """A valid specification that cannot be run on this machine."""

    def __init__(self, problems: Sequence[str]) -> None:
        self._problems = tuple(problems)
        super().__init__("\n".join(problems))

    @property
    def lines(self) -> tuple[str, ...]:
        """One line per problem."""
        return self._problems


def run_info(system: System, start_s: float) -> RunInfo:
    """Return what the recorder gets at the start of a run; `start_s` is the moment that the report calls 0."""
    return of_run(system.spec, system.mode.value, system.seed, start_s)


# -- programs ---------------------------------------------------------------------------------------------------------


def programs(system: System, clients: Sequence[str] = ()) -> tuple[Program, ...]:
    """Return everything that runs beside the wire, in starting order, and write the agents' files.

    Args:
        system: what to run.
        clients: names of further clients that get certificates for the cloud agent, see `make_certificates`.
    """
    certificates = make_certificates(
        system.certificates,
        robot=system.offload.metadata.name,
        host_names=[system.cloud_host],
        now=datetime.datetime.now(tz=datetime.UTC),
        clients=clients,
    )
    return (
        recorder(system),
        *joined(system, certificates),
        *(agent(system, side, certificates, clients) for side in system.sides),
        *(program for side in system.sides for program in _nodes(system, side)),
    )


def joined(system: System, certificates: CertificatePaths) -> Iterator[Program]:
    """Yield what joins the two domains: DDS Routers where wanted and installed, else the emulated DDS link."""
    if system.routed:
        yield from routed.programs(system, certificates)
    elif system.joined_by_dds_wire:
        yield dds_wire(system)


def recorder(system: System) -> Program:
    """Return the consumer that records what it receives."""
    command = [sys.executable, "-m", "robot_offload_lab.judge.recorder", str(system.recording)]
    for topic, type_name in system.outputs.items():
        command += ["--topic", f"{topic}={type_name}"]
    for name, topic in system.said.accounts.items():
        command += [f"--{name}", topic] if topic else []
    if system.wired:
        command += ["--link", json.dumps(dataclasses.asdict(system.link))]
    priority = RECORDER_PRIORITY if system.realtime else 0
    return Program(RECORDER, tuple(command), system.out, environment(system, "robot"), piped=True, priority=priority)


def recording_in_the_fields_format(system: System) -> Program:
    """Return the program that records the robot's side as MCAP, like the robot's own command; it reads its file."""
    command = ("record", "--params", str(system.out / "robot.yaml"), "--output", str(system.mcap))
    return Program(
        MCAP, (sys.executable, "-m", "robot_offload_agent.main", *command), system.out, environment(system, "robot")
    )


def dds_wire(system: System) -> Program:
    """Return the program that carries topics between the domains when the agents have no sessions of their own."""
    file = system.out / "dds-wire.json"
    config = DdsWireConfig(system.domains, carried(system.spec), system.link, system.seed)
    file.write_text(config.to_json(), encoding="utf-8")
    command = (sys.executable, "-m", "robot_offload_lab.wire.dds", str(file))
    priority = REALTIME_PRIORITY if system.realtime else 0
    return Program(DDS_WIRE, command, system.out, environment(system, "robot"), piped=True, priority=priority)


def agent(system: System, side: Side, certificates: CertificatePaths, observers: Sequence[str] = ()) -> Program:
    """Return the agent of one side, and write its file; `observers` may listen to the cloud's agent."""
    files = certificates.robot if side == "robot" else certificates.cloud
    ports = system.dialled if side == "robot" else system.served
    site = AgentSite(
        side=side,
        host=system.cloud_host,
        ca=str(files.ca),
        certificate=str(files.certificate),
        private_key=str(files.private_key),
        pulse_port=ports[0],
        data_port=ports[1],
        uid=system.uid,
        domain_id=_domain(system, side),
        runtime_dir=str(system.temporary / side),
        state_dir=str(fresh_state(system, side)),
        realtime=system.realtime,
        observers=tuple(observers),
        state_file=system.state_file if side == "cloud" else "",
        settings_file=system.settings_file if side == "cloud" else "",
    )
    file = system.out / f"{side}.yaml"
    file.write_text(agent_config(system.offload, site), encoding="utf-8")
    command = (sys.executable, "-m", "robot_offload_agent.main", side, "--params", str(file))
    return Program(f"{side}-agent", command, system.out, environment(system, side))


def fresh_state(system: System, side: Side) -> Path:
    """Return the folder, emptied of earlier runs, for what outlives a side's agent, its black box included."""
    folder = system.out / "state" / side
    shutil.rmtree(folder, ignore_errors=True)
    return folder


def _nodes(system: System, side: Side) -> Iterator[Program]:
    """Yield the programs of the user's nodes of one side, in the order of the nodes."""
    shared = {name: together for together in system.said.processes for name in together.nodes}
    here = system.runs_on(side)
    started = set()
    for node in here:
        together = shared.get(node.name)
        if together is None:
            name, command = ros_names.replica_name(node, side), _command(system, node, side)
        elif together.name in started:
            continue
        else:
            started.add(together.name)
            nodes = [it for it in here if it.name in together.nodes]
            name = together.name
            command = ros_names.shared_command(system.spec, together.command, nodes, side)
        program, *arguments = command
        yield Program(
            f"{side}-{name}",
            (sys.executable if program in ("python", "python3") else program, *arguments),
            system.source,
            environment(system, side),
            priority=NODE_PRIORITY if system.realtime else 0,
        )


def _command(system: System, node: Node, side: Side) -> tuple[str, ...]:
    """Return the command line of a node; the executable of a package is started by its path."""
    command = ros_names.command(system.spec, node, side)
    if node.run is None or node.run.command:
        return command
    return (str(_executable(node.run)), *command[3:])  # instead of `ros2 run PACKAGE NAME`


def _executable(run: Run) -> Path:
    return packages.executable(str(run.package), str(run.executable), os.environ)


def environment(system: System, side: Side) -> Mapping[str, str]:
    """Return the variables of a side's processes."""
    own = {name: value for name, value in os.environ.items() if name not in _FOREIGN}
    if system.interfaces:
        from robot_offload_lab.run import interfaces  # noqa: PLC0415 - the generators are slow to import

        own |= interfaces.environment(*system.interfaces)
    return own | {
        "ROS_DOMAIN_ID": str(_domain(system, side)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "RMW_IMPLEMENTATION": system.spec.robot.rmw,
        "ROS_LOG_DIR": str(system.logs / "ros"),
        "XDG_STATE_HOME": str(system.temporary / "state"),
        "PYTHONUNBUFFERED": "1",
    }


def _domain(system: System, side: Side) -> int:
    return system.domains[0 if side == "robot" else 1]


# -- the wire ---------------------------------------------------------------------------------------------------------


def wire_config(system: System) -> WireConfig:
    """Return the emulated link: every port in both protocols. TLS over TCP carries the fallback and the tunnel."""
    forwards = []
    for session, dialled, served in zip(("pulse", "data"), system.dialled, system.served, strict=True):
        forwards.append(Forward(session, "udp", f"{HOST}:{dialled}", f"{HOST}:{served}"))
        if system.routed or system.spec.transport.zenoh.fallback:
            forwards.append(Forward(f"{session}-fallback", "tcp", f"{HOST}:{dialled}", f"{HOST}:{served}"))
    return WireConfig(
        forwards=tuple(forwards),
        link=system.link,
        seed=system.seed,
        control=str(system.temporary / "wire.sock"),
        log=str(system.logs / "wire.jsonl"),
        realtime=system.realtime,
    )
