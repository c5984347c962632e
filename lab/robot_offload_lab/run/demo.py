"""Runs one RobotOffload on this machine, over a link that fails as its options say, and reports what consumers felt.

    load -> prepare -> start -> wait until both sides are up -> start the link's schedule -> watch -> end -> report

Everything is real but the link: the user's nodes, both agents, ROS domains of their own, mutual TLS with certificates
made for this run. The figures come from the recorder, a consumer outside the agents.
"""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import secrets
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Final

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.errors import InputError, RobotOffloadError
from robot_offload_lab.judge import recording
from robot_offload_lab.judge.busy import UNKNOWN, Computer
from robot_offload_lab.judge.recording import LinkSample
from robot_offload_lab.run import usage
from robot_offload_lab.run.ensemble import Ensemble
from robot_offload_lab.run.free import free_domains, free_ports
from robot_offload_lab.run.processes import Processes, Program
from robot_offload_lab.run.showcase import Showcase, showcase
from robot_offload_lab.run.standstill import Standstill
from robot_offload_lab.run.system import (
    DDS_WIRE,
    MCAP,
    RECORDER,
    Mode,
    System,
    adapted,
    check_runnable,
    programs,
    recording_in_the_fields_format,
    run_info,
    wire_config,
)
from robot_offload_lab.run.warned import Warned, Warnings
from robot_offload_lab.show.view import View
from robot_offload_lab.show.watch import LiveRun
from robot_offload_lab.wire.emulated import EmulatedWire
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions

LONGEST_S: Final = 75.0
"""A run without a given duration ends at the goal, or after this time at the latest."""
START_TIMEOUT_S: Final = 90.0
"""More than a busy machine needs to start a dozen processes."""
RECORDER_GRACE_S: Final = 30.0
"""More than a busy machine needs to write the end of a recording."""
RESOURCE: Final = "robotoffload.json"
"""File beside the recording with the resource that ran, for later viewers."""
STATE_FILE: Final = "cloud-state.json"
_LOOK_S: Final = 0.05
_REST_S: Final = 0.5
"""How long the run goes on after the goal is reached, so that the stop is seen."""
_RESULT_S: Final = 5.0
"""How long after the goal a client's result is awaited; then the run ends without it."""


@dataclass(frozen=True)
class DemoOptions:
    """What to run.

    Attributes:
        spec: the specification.
        mode: see Mode.
        duration_s: None: until the goal is reached, at most longest_s.
        link: what the emulated link does.
        seed: of link and world.
        out: folder for the report.
        realtime: ask for real-time priority.
        transport: a transport type instead of the specification's; empty: the specification's.
        domains: ROS domains of robot and cloud; None picks free ones.
        adapt: changes the resource before it runs.
        longest_s: see duration_s.
        seen: adds another display of the run; gets the view and the system that is about to start.
    """

    spec: Path
    mode: Mode = Mode.OFFLOAD
    duration_s: float | None = None
    link: LinkOptions = field(default_factory=LinkOptions)
    seed: int = 1
    out: Path = Path("out/demo")
    realtime: bool = False
    transport: str = ""
    domains: tuple[int, int] | None = None
    adapt: Callable[[RobotOffload], RobotOffload] = lambda offload: offload
    longest_s: float = LONGEST_S
    seen: Callable[[View, System], View] | None = None


@dataclass(frozen=True)
class DemoResult:
    """What came out.

    Attributes:
        report: as in report.json.
        recording: the file from which the report was made.
        trouble: what, other than the user, ended the run early; empty when nothing did.
        standstill: a sentence about a machine that stood still; empty when it ran all the time.
    """

    report: Mapping[str, Any]
    recording: Path
    trouble: str = ""
    standstill: str = ""


class StoppedEarlyError(RobotOffloadError):
    """The user stopped before there was anything to report."""


def run(options: DemoOptions, view: View) -> DemoResult:
    """Run it and write the report.

    Raises:
        InputError: the specification or an option is wrong; nothing was started.
        StartError, ProcessError, WireProcessError: something did not start.
        StoppedEarlyError: a signal came before the system was up.
    """
    offload = options.adapt(load(options.spec))
    said = showcase(options.spec)
    check_runnable(offload, options.spec, said)
    schedule = options.link.schedule()
    with ExitStack() as stack:
        stop = stack.enter_context(stop_requests())
        _claim(options.out, stack)
        temporary = stack.enter_context(tempfile.TemporaryDirectory(prefix="ro-", ignore_cleanup_errors=True))
        system = _system(options, offload, said, _made(options.spec.parent, said, view), Path(temporary))
        _clear(system)
        (system.out / RESOURCE).write_text(json.dumps(manifest(system.offload), indent=2) + "\n", encoding="utf-8")
        threshold_ms = system.spec.switching.latency.allowed_loop_ms
        if options.seen is not None:
            view = options.seen(view, system)
        watch = LiveRun(threshold_ms, outputs=system.awaited, unrated=recording.unrated(system.spec))
        if system.wired:
            watch.link = LinkSample(steady_s(), schedule.latency_ms(0.0))
        processes = stack.enter_context(Processes(system.run, system.logs, system.temporary))
        stack.callback(view.close)
        machine = stack.enter_context(Standstill())
        demo = Demo(system, processes, view, watch, stop)
        trouble = demo.go(options.duration_s, options.longest_s)
        view.close()
        for line in agent_errors(system):
            view.say(line)
        view.say("Writing the report")
    computer = Computer(demo.busy_share, max(machine.lengths_s, default=0.0))
    written = write_report(system, demo.processor, computer, demo.warnings.found)
    return DemoResult(written, system.recording, trouble, machine.sentence())


def manifest(offload: RobotOffload) -> dict[str, Any]:
    """Return a resource as in its YAML, defaults included."""
    written: dict[str, Any] = offload.model_dump(mode="json", by_alias=True, exclude_none=True)
    return written


def _made(folder: Path, said: Showcase, view: View) -> tuple[Path, ...]:
    """Make the interface packages of an example, once for all runs; return where they are."""
    if not said.interfaces:
        return ()
    from robot_offload_lab.run import interfaces  # noqa: PLC0415 - the generators are slow to import

    packages = [interfaces.read(folder / name) for name in said.interfaces]
    if missing := [package.name for package in packages if not interfaces.is_cached(package)]:
        view.say(f"Making the interfaces {', '.join(missing)}, this time only")
    return tuple(interfaces.cached(package) for package in packages)


def _system(
    options: DemoOptions, offload: RobotOffload, said: Showcase, made: tuple[Path, ...], temporary: Path
) -> System:
    dialled, served = free_ports()
    return System(
        offload=adapted(offload, options.mode, options.seed, options.transport),
        source=options.spec.resolve().parent,
        mode=options.mode,
        run=secrets.token_hex(8),
        out=options.out.resolve(),
        temporary=temporary,
        domains=options.domains or free_domains(),
        link=options.link,
        state_file=str(temporary / STATE_FILE) if options.seen is not None else "",
        seed=options.seed,
        realtime=options.realtime,
        dialled=dialled,
        served=served,
        said=said,
        interfaces=made,
    )


def write_report(
    system: System,
    processor: Mapping[str, float] | None = None,
    computer: Computer = UNKNOWN,
    warned: Sequence[Warned] = (),
) -> Mapping[str, Any]:
    """Write report.json, report.html and run.png; return the first. `processor`: see `usage.percent`."""
    from robot_offload_lab.judge import report  # noqa: PLC0415 - matplotlib would make every start a second longer

    warnings = [dataclasses.asdict(one) for one in warned]
    files = report.write(recording.read(system.recording), system.out, processor, computer, warnings)
    written: Mapping[str, Any] = json.loads(files.json.read_text(encoding="utf-8"))
    return written


def agent_errors(system: System) -> Iterator[str]:
    """Yield one line for each agent that logged errors, such as a process that died."""
    for side in system.sides:
        log = system.logs / f"{side}-agent.log"
        errors = [line for line in log.read_text(errors="replace").splitlines() if " ERROR " in line]
        if errors:
            yield f"The {side}'s agent logged {len(errors)} errors, see {log}; the first: {errors[0]}"


# -- signals ----------------------------------------------------------------------------------------------------------


@dataclass
class StopRequest:
    """Whether the user or a signal asked for a stop, and how."""

    signal: signal.Signals | None = None

    def __bool__(self) -> bool:
        return self.signal is not None


@contextmanager
def stop_requests() -> Iterator[StopRequest]:
    """Take Ctrl-C, SIGTERM and a closed terminal as a request for an orderly end; a second Ctrl-C ends at once."""
    request = StopRequest()

    def on_signal(number: int, _frame: FrameType | None) -> None:
        if request and number == signal.SIGINT:
            raise KeyboardInterrupt
        request.signal = signal.Signals(number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    # Signals that our caller made us ignore (nohup, a background job) stay ignored.
    heeded = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, on_signal) for number in heeded}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# -- the folder -------------------------------------------------------------------------------------------------------


def _claim(out: Path, stack: ExitStack) -> None:
    """Make the folder and keep other runs out of it."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise InputError(f"--out: {out}: cannot be used: {error.strerror}") from error
    stack.callback(os.close, descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise InputError(f"--out: {out}: another run writes here; give this one a folder of its own") from error


def _clear(system: System) -> None:
    """Remove the files of an earlier run, and nothing else."""
    for name in (
        "report.json",
        "report.html",
        "run.png",
        "recording.jsonl",
        "run.mcap",
        "robot.yaml",
        "cloud.yaml",
        "dds-wire.json",
        RESOURCE,
    ):
        (system.out / name).unlink(missing_ok=True)
    for folder in (system.logs, system.certificates):
        shutil.rmtree(folder, ignore_errors=True)
    system.logs.mkdir()


# -- the run ----------------------------------------------------------------------------------------------------------


class Demo:
    """One run from the start of its processes to their end."""

    def __init__(self, system: System, processes: Processes, view: View, watch: LiveRun, stop: StopRequest) -> None:
        self._system = system
        self._programs = Ensemble(processes, system.logs, lambda _, line: watch.take(line))
        self._view = view
        self._watch = watch
        self._stop = stop
        self._wire: EmulatedWire | None = None
        self.warnings = Warnings({side: system.logs / f"{side}-agent.log" for side in system.sides})
        self.processor: dict[str, float] = {}
        """Share of one core that each program used from the start of the schedule to the end, percent."""
        self.busy_share: float | None = None
        """Share of all cores that was in use in that time, 0..1."""

    def go(self, duration_s: float | None, longest_s: float) -> str:
        """Start, watch and end the run; return what went wrong, empty when nothing did."""
        with ExitStack() as stack:
            if self._system.wired and not self._system.joined_by_dds_wire:
                self._wire = stack.enter_context(EmulatedWire(wire_config(self._system), self._system.temporary))
            self._start((*programs(self._system), recording_in_the_fields_format(self._system)))
            self._await_up()
            self._begin()
            before = usage.read(self._programs.pids)
            trouble = self._drive(duration_s, longest_s)
            after = usage.read(self._programs.pids)
            self.processor, self.busy_share = usage.percent(before, after), usage.busy_share(before, after)
            # The recorder is informed that the run is over before anything else ends.
            self._programs.finish(RECORDER, {"end": steady_s()}, RECORDER_GRACE_S)
            self._programs.processes.end(MCAP, RECORDER_GRACE_S)
            self._view.say("Ending the processes")
            self._programs.processes.stop()
        return trouble

    def _start(self, all_programs: tuple[Program, ...]) -> None:
        robot, cloud = self._system.domains
        alone = self._system.mode is Mode.ROBOT_ONLY
        domains = f"ROS domain {robot}" if alone else f"ROS domains {robot} and {cloud}"
        self._view.say(f"Starting {len(all_programs)} processes in {domains}; logs in {self._system.logs}")
        for program in all_programs:
            self._programs.start(program)

    def _await_up(self) -> None:
        """Wait until every output was received, the robot's nodes are configured and the two agents have met."""
        began_s = steady_s()
        give_up_s = began_s + START_TIMEOUT_S
        while self._missing():
            if self._stop:
                raise StoppedEarlyError("Stopped before the system was up; there is nothing to report")
            self._look()
            self._programs.check("the system is up", None if steady_s() < give_up_s else self._missing())
        self._view.say(f"Up after {steady_s() - began_s:.1f} s")

    def _missing(self) -> str:
        """Return in words what is not up yet; empty when everything is."""
        watch = self._watch
        missing = [f"nothing was heard on {topic}" for topic in watch.missing()]
        if watch.placement is None:
            missing.append("the robot's agent has announced no placement")
        states = {name: watch.nodes.get(name, "unknown") for name in self._system.managed_on_robot}
        missing += [f"{name} is {state}" for name, state in states.items() if state not in ("inactive", "active")]
        if self._system.wired and watch.round_trip_ms is None:
            missing.append("the two agents have not met")
        return ", ".join(missing)

    def _begin(self) -> None:
        """Start the link's schedule; from here on the recording counts."""
        start_s = self._wire.start_schedule() if self._wire else steady_s()
        self._watch.start_s = start_s
        self.warnings.starting = False
        if self._system.joined_by_dds_wire:
            self._programs.command(DDS_WIRE, {"start": start_s})
        self._programs.command(RECORDER, {"start": dataclasses.asdict(run_info(self._system, start_s))})

    def _drive(self, duration_s: float | None, longest_s: float) -> str:
        """Follow the run until the goal, the duration, a signal or the death of a process; return how it died."""
        assert self._watch.start_s is not None
        end_s = self._watch.start_s + (longest_s if duration_s is None else duration_s)
        resting, ended_s = False, 0.0
        while not self._stop and steady_s() < end_s:
            self._look()
            ended = self._programs.processes.first_ended()
            if ended is not None:
                self._view.say(f"{ended.describe()}; see {ended.log}")
                return ended.describe()
            if duration_s is None and self._watch.goal_reached and not resting:
                resting, end_s = True, min(end_s, steady_s() + _RESULT_S)
            if resting and not ended_s and not self._watch.under_way:
                ended_s = steady_s()
                end_s = min(end_s, ended_s + _REST_S)
        return ""

    def _look(self) -> None:
        """Read the recorder's output for a short while, and show the state of the run."""
        self._programs.look(_LOOK_S)
        now_s = steady_s()
        self._watch.attend(now_s)
        self._view.show(self._watch, now_s)
        for warned in self.warnings.look():
            self._view.say(warned.sentence())
