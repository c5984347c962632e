"""One measured system: both sides of a case on this machine, the emulated link, and the observers around them.

The product's own parts for running on one machine (`run`) are used unchanged: processes, wire, certificates, recorder.
Added are observers, and control of the link by hand.
"""

from __future__ import annotations

import dataclasses
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, Self

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.names import Side
from robot_offload_lab.bench import observed
from robot_offload_lab.bench.observed import Answered, Observation
from robot_offload_lab.bench.resource import MESSAGE_TYPE, NODE, BenchCase, offload
from robot_offload_lab.judge import recording
from robot_offload_lab.judge.recording import PlacementChange, Recording
from robot_offload_lab.run.certificates import client_paths
from robot_offload_lab.run.ensemble import Ensemble
from robot_offload_lab.run.free import HOST, free_domains, free_ports
from robot_offload_lab.run.processes import Processes, Program
from robot_offload_lab.run.system import (
    RECORDER,
    Mode,
    System,
    environment,
    programs,
    run_info,
    wire_config,
)
from robot_offload_lab.wire.emulated import EmulatedWire, Forward, WireConfig
from robot_offload_lab.wire.loop import steady_s

Direction = Literal["up", "down", "both"]

START_PATIENCE_S: Final = 100.0
SETTLE_S: Final = 2.0
GRACE_S: Final = 5.0
OBSERVER_PRIORITY: Final = 4
"""SCHED_FIFO, below the agents' (5 and 10), so that no observer ever holds up what it observes."""
NODE_PRIORITY: Final = 3
OBSERVER: Final = "observer"
INPUT_RECORDER: Final = "input-recorder"
RELAY: Final = "hop"
GOAL_CLIENT: Final = "goal-client"


@dataclass(frozen=True)
class Setting:
    """How a world is run.

    Attributes:
        folder: for everything that is kept; made anew.
        realtime: whether agents and the user's nodes run under SCHED_FIFO. Wire and observers always do if permitted.
        domains: ROS domains of robot and cloud; None picks free ones.
        seed: seed of the link's random draws.
        lease: whether the observer of the lease runs.
        hops: whether datagrams of our own go through the wire.
        goals: whether there are a client of actions and services, and servers that it reaches directly.
        offload: the resource, if it is not the case's own.
        agents: tree of the repository whose agents run; None: this one's.
        beats: whether the witnesses listen to the heartbeats, which makes the agents spend time on publishing them.
    """

    folder: Path
    realtime: bool
    domains: tuple[int, int] | None = None
    seed: int = 1
    lease: bool = False
    hops: bool = False
    goals: bool = False
    offload: RobotOffload | None = None
    agents: Path | None = None
    beats: bool = True


@dataclass(frozen=True)
class Evidence:
    """Everything that the observers of one world have written.

    Attributes:
        recording: from the consumer on the robot.
        inputs: from the consumer in the cloud, None without one.
        robot, cloud: from the witnesses in the two domains.
        lease: from the observer of the lease.
        hops: from the datagrams of our own.
        goals: from the client of actions and services.
    """

    recording: Recording
    inputs: Recording | None
    robot: tuple[Observation, ...]
    cloud: tuple[Observation, ...]
    lease: tuple[Observation, ...]
    hops: tuple[Observation, ...]
    goals: tuple[Observation, ...] = ()


class MeasuredSystem:
    """A context manager: after entering it the cloud is in charge and the recording has begun."""

    def __init__(self, case: BenchCase, setting: Setting) -> None:
        self.case = case
        self.setting = setting
        self.placed: PlacementChange | None = None
        self.answer: Answered | None = None
        self.answers: list[Observation] = []
        self._stack = ExitStack()
        self._commands_heard = 0

    def __enter__(self) -> Self:
        try:
            self._open()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    # -- what a measurement does --------------------------------------------------------------------------------------

    @property
    def site(self) -> str:
        """The side in charge, as announced."""
        return self.placed.site if self.placed else ""

    def until(self, condition: Callable[[], bool], what: str, patience_s: float = START_PATIENCE_S) -> None:
        """Wait for a condition on what the observers print.

        Raises:
            StartError: the condition did not come true, or a process ended.
        """
        self.programs.until(condition, what, patience_s, ("robot-agent", "cloud-agent"))

    def rest(self, seconds: float) -> None:
        """Let time pass, following what the observers print."""
        self.programs.rest(seconds)

    def ask(self, site: str) -> None:
        """Ask for a switch by hand until it is accepted, then wait until it has taken place."""
        self.until(lambda: self._accepted(site), f"the switch to the {site} by hand is accepted")
        self.until(lambda: self.site == site, f"the {site} is in charge")

    def have(self, count: int, command: dict[str, object], what: str) -> None:
        """Have the client of actions and services do something, and wait for `count` more answers from it."""
        known = len(self.answers)
        self.programs.command(GOAL_CLIENT, command)
        self.until(lambda: len(self.answers) >= known + count, what)

    def cut(self, direction: Direction | None) -> tuple[float, float]:
        """Cut the link, or with None restore it; return the moments just before and just after that."""
        before_s = steady_s()
        self.wire.cut(direction)
        return before_s, steady_s()

    def agent(self, side: Side) -> tuple[int, ...]:
        """Return the processes of one side's agent: the supervisor and its children."""
        children = sorted((self.system.temporary / side).glob("*.pid"))
        return (self.programs.pids[f"{side}-agent"], *(int(path.read_text()) for path in children))

    def finish(self) -> Evidence:
        """End the recording, then everything else; return what the observers wrote."""
        for name in (RECORDER, INPUT_RECORDER):
            if name in self.programs:
                self.programs.finish(name, {"end": steady_s()}, GRACE_S)
        self.programs.processes.stop()
        out = self.system.out
        inputs = out / f"{INPUT_RECORDER}.jsonl"
        return Evidence(
            recording=recording.read(self.system.recording),
            inputs=recording.read(inputs) if inputs.exists() else None,
            robot=observed.read(out / "robot-witness.jsonl"),
            cloud=observed.read(out / "cloud-witness.jsonl"),
            lease=observed.read(out / "lease.jsonl"),
            hops=observed.read(out / "hops.jsonl"),
            goals=observed.read(out / f"{GOAL_CLIENT}.jsonl"),
        )

    # -- bringing it up -----------------------------------------------------------------------------------------------

    def _open(self) -> None:
        shutil.rmtree(self.setting.folder, ignore_errors=True)
        temporary = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="ro-", ignore_cleanup_errors=True))
        self.system = self._system(Path(temporary))
        self.system.logs.mkdir(parents=True)
        self.relay = (free_ports()[0][0], free_ports()[1][0])
        logs = self.system.logs
        processes = self._stack.enter_context(Processes(self.system.run, logs, self.system.temporary))
        self.programs = Ensemble(processes, logs, self._take)
        self.wire = self._stack.enter_context(self._make_wire())
        self._prepare()
        for program in programs(self.system, clients=(OBSERVER,)):
            self._start(program)
        for program in self._observers():
            self._start(program)
        self.until(self._settled, "the cloud acts")
        if self.setting.lease:
            lease = self.system.out / "lease.jsonl"
            self.until(lambda: lease.exists() and lease.stat().st_size > 0, "the observer of the lease hears the cloud")
        start = {"start": dataclasses.asdict(run_info(self.system, self.wire.start_schedule()))}
        for name in (RECORDER, INPUT_RECORDER):
            if name in self.programs:
                self.programs.command(name, start)

    def _system(self, temporary: Path) -> System:
        dialled, served = free_ports()
        return System(
            offload=self.setting.offload or offload(self.case),
            source=self.setting.folder.resolve(),
            mode=Mode.OFFLOAD,
            run=secrets.token_hex(8),
            out=self.setting.folder.resolve(),
            temporary=temporary,
            domains=self.setting.domains or free_domains(),
            link=self.case.link,
            seed=self.setting.seed,
            realtime=self.setting.realtime,
            dialled=dialled,
            served=served,
        )

    def _make_wire(self) -> EmulatedWire:
        return EmulatedWire(self._wire_config())

    def _prepare(self) -> None:
        """Do what the link needs before anything is started."""

    def _placed(self, program: Program) -> Program:
        """Return a program in the form in which it is started on its side."""
        return program

    def _wire_config(self) -> WireConfig:
        config = wire_config(self.system)
        forwards = config.forwards
        if self.setting.hops:
            dial, serve = self.relay
            forwards = (*forwards, Forward(RELAY, "udp", f"{HOST}:{dial}", f"{HOST}:{serve}"))
        return dataclasses.replace(config, forwards=forwards, realtime=True)

    def _start(self, program: Program) -> None:
        if program.name.endswith("-agent") and self.setting.agents is not None:
            path = os.pathsep.join(str(self.setting.agents / package) for package in ("core", "agent"))
            program = dataclasses.replace(program, environment={**program.environment, "PYTHONPATH": path})
        child = self.programs.start(self._placed(program))
        priority = self._priority(program)
        if priority:
            # Threads inherit it; the program has none yet. If not permitted, the program runs without it.
            with suppress(PermissionError, ProcessLookupError):
                os.sched_setscheduler(child.pid, os.SCHED_FIFO, os.sched_param(priority))

    def _priority(self, program: Program) -> int:
        """Return the priority of a program; agents ask for theirs themselves."""
        if program.name.endswith("-agent"):
            return 0
        if program.folder == self.system.source and program.name.startswith(("robot-", "cloud-")):
            return NODE_PRIORITY if self.setting.realtime else 0
        return OBSERVER_PRIORITY

    def _observers(self) -> Sequence[Program]:
        found = [self._witness("robot", NODE), self._witness("cloud", f"remote_{NODE}")]
        if self.setting.lease:
            found.append(self._lease_observer())
        if self.setting.hops:
            found.append(self._hop())
        if self.setting.goals:
            path = self.system.out / f"{GOAL_CLIENT}.jsonl"
            found += [
                self._program(GOAL_CLIENT, "goal_client", "robot", path, piped=True),
                self._program("direct-server", "goal_server", "robot", "/direct"),
            ]
        return found

    def _program(self, name: str, module: str, side: Side, *arguments: object, piped: bool = False) -> Program:
        command = (sys.executable, "-m", f"robot_offload_lab.bench.parts.{module}", *map(str, arguments))
        return Program(name, command, self.system.temporary, environment(self.system, side), piped=piped)

    def _witness(self, side: Side, node: str) -> Program:
        name = f"{side}-witness"
        words = ("--node", node, *(() if self.setting.beats else ("--no-beats",)))
        return self._program(name, "witness", side, self.system.out / f"{name}.jsonl", *words, piped=True)

    def _lease_observer(self) -> Program:
        files = client_paths(self.system.certificates, OBSERVER)
        pulse, data = (f"{HOST}:{port}" for port in self.system.served)
        options = {
            "uid": self.system.uid, "pulse": pulse, "data": data, "ca": files.ca,
            "certificate": files.certificate, "private-key": files.private_key,
        }  # fmt: skip
        words = [word for name, value in options.items() for word in (f"--{name}", value)]
        return self._program("lease-observer", "lease_observer", "cloud", self.system.out / "lease.jsonl", *words)

    def _input_recorder(self) -> Program:
        path = self.system.out / f"{INPUT_RECORDER}.jsonl"
        command = [sys.executable, "-m", "robot_offload_lab.judge.recorder", str(path)]
        for sensor in self.case.sensors:
            command += ["--topic", f"{sensor.topic}={MESSAGE_TYPE}"]
        cloud = environment(self.system, "cloud")
        return Program(INPUT_RECORDER, tuple(command), self.system.temporary, cloud, piped=True)

    def _hop(self) -> Program:
        dial, serve = self.relay
        options = ("--dial", dial, "--serve", serve, "--period", 1.0 / self.case.cloud_rate_hz)
        return self._program(RELAY, "hop", "robot", self.system.out / "hops.jsonl", *options, *self.case.command_bytes)

    # -- following the observers --------------------------------------------------------------------------------------

    def _settled(self) -> bool:
        """Return whether the cloud has acted for a while: starting a dozen processes at once is not the subject."""
        charged_s = self.placed.decided_s if self.placed and self.placed.site == "cloud" else float("inf")
        return self._commands_heard > 0 and steady_s() - charged_s > SETTLE_S

    def _accepted(self, site: str) -> bool:
        """Ask once and wait for the answer."""
        self.answer = None
        self.programs.command("robot-witness", {"ask": site})
        self.until(lambda: self.answer is not None, "the robot's agent answers a switch by hand")
        assert self.answer is not None
        return self.answer.accepted

    def _take(self, name: str, line: str) -> None:
        if name == RECORDER:
            self._commands_heard += '"site":"cloud"' in line
        if name == GOAL_CLIENT:
            self.answers.append(observed.LINES.decode(line))
        if name != "robot-witness":
            return
        observation = observed.LINES.decode(line)
        if isinstance(observation, PlacementChange):
            self.placed = observation
        elif isinstance(observation, Answered):
            self.answer = observation
