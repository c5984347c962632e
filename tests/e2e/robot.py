"""A robot outside the cluster: its agent is started from the bundle alone, beside its own nodes and a recorder.

The recorder is a consumer of the robot's outputs and no part of the agent: what it hears is what the actuators get.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from robot_offload.api.v1alpha1 import Node, RobotOffload
from robot_offload.render import ros_names
from robot_offload_lab.cluster.robot_host import RobotHost
from robot_offload_lab.judge import recording
from robot_offload_lab.judge.measures import Measures, measure
from robot_offload_lab.run.showcase import Showcase, showcase
from robot_offload_lab.run.system import NODE_PRIORITY, RECORDER_PRIORITY
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from tests.e2e.consumer import WHEELCHAIR, Consumer

EXAMPLES: Final = Path(__file__).parents[2] / "examples"
APPS: Final = Path(__file__).parent / "apps"
UNIT: Final = "robot-offload-agent.service"
END_S: Final = 5.0
SITE_S: Final = 120.0
"""For a side to be in charge: the hold-down before a return to the cloud grows with each change, up to half a minute,
and a busy machine adds changes."""
_EXEC_START: Final = re.compile(r"^ExecStart=(.+)$", re.MULTILINE)
_ENVIRONMENT: Final = re.compile(r"^Environment=(.+)$", re.MULTILINE)


class Robot:
    """One robot: a host, a bundle, the robot's own nodes."""

    def __init__(self, host: RobotHost, offload: RobotOffload, bundle: Path, folder: Path, example: str = "") -> None:
        """Puts the bundle where its README says; starts nothing.

        Args:
            host: where everything runs.
            offload: what the bundle was made for.
            bundle: as `kubectl offload bundle` has written it.
            folder: for logs and recordings.
            example: whose demo.yaml says which nodes share a process, and which interface packages they need; empty:
                each node has a process, and the packages of ROS 2 are enough.
        """
        self.host = host
        self.offload = offload
        self.folder = folder
        self.said = showcase(EXAMPLES / example / "robotoffload.yaml") if example else Showcase(**WHEELCHAIR)
        self._workspace = _made(EXAMPLES / example, self.said)
        self.consumer: Consumer | None = None
        self.link: LinkOptions | None = None
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._begun_s: float | None = None
        folder.mkdir(parents=True, exist_ok=True)
        self.install(bundle)

    @property
    def name(self) -> str:
        """Of the RobotOffload."""
        return self.offload.metadata.name

    @property
    def place(self) -> Path:
        """Where the bundle lies, on the robot."""
        return Path("/etc/robot-offload") / self.name

    # -- installing ---------------------------------------------------------------------------------------------------

    def install(self, bundle: Path) -> None:
        """What the bundle's README says: copy the folder, name the setup script of the own workspace."""
        self.bundle = bundle
        setup = self.folder / "setup.bash"
        # This machine has no /opt/ros: ROS comes with the Python environment, which is this robot's workspace.
        own = "".join(f"export {name}={value}\n" for name, value in self._workspace.items())
        setup.write_text(f"export PATH={Path(sys.executable).parent}:$PATH\n{own}", encoding="utf-8")
        self._do(
            "mkdir", "-p", str(self.place), f"/run/robot-offload/{self.name}", f"/var/lib/robot-offload/{self.name}"
        )
        self._do("cp", "-rT", str(bundle), str(self.place))
        edit = f"s|^ROBOT_OFFLOAD_SETUP=.*|ROBOT_OFFLOAD_SETUP={setup}|"
        self._do("sed", "-i", edit, str(self.place / "environment"))

    def _do(self, *command: str) -> None:
        child = self.host.start(command, dict(os.environ), self.folder / "install.log")
        if child.wait(60):
            raise AssertionError(f"{shlex.join(command)} failed: {(self.folder / 'install.log').read_text()[-500:]}")

    # -- processes ----------------------------------------------------------------------------------------------------

    def environment(self) -> dict[str, str]:
        """What a shell on the robot has after reading the bundle's `environment`."""
        text = (self.bundle / "environment").read_text(encoding="utf-8")
        own = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
        return {
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "LANG": "C.UTF-8",
            "HOME": str(self.folder),
            "ROS_LOG_DIR": str(self.folder / "ros"),
            "PYTHONUNBUFFERED": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            **self._workspace,
            **own,
            "ROBOT_OFFLOAD_SETUP": str(self.folder / "setup.bash"),
        }

    def start_agent(self) -> float:
        """Starts the agent as the bundle's unit does; returns the moment (steady clock, seconds)."""
        text = (self.bundle / UNIT).read_text(encoding="utf-8")
        found = _EXEC_START.search(text)
        assert found is not None, f"{UNIT} has no ExecStart"
        command = shlex.split(found[1].replace("$$", "$"))
        own = dict(pair.split("=", 1) for line in _ENVIRONMENT.findall(text) for pair in shlex.split(line))
        began_s = steady_s()
        self._start("agent", command, {**own, **self.environment()})  # this robot's home and logs are elsewhere
        return began_s

    def start_nodes(self) -> None:
        """The robot's own nodes, each with the remappings that the bundle's README lists."""
        here = ros_names.nodes_on(self.offload.spec, "robot")
        together = {name for shared in self.said.processes for name in shared.nodes}
        for node in here:
            if node.name not in together:
                self.start_node(node)
        for shared in self.said.processes:
            if nodes := [node for node in here if node.name in shared.nodes]:
                self._run(shared.name, ros_names.shared_command(self.offload.spec, shared.command, nodes, "robot"))

    def start_node(self, node: Node) -> None:
        """One of the robot's own nodes."""
        self._run(node.name, ros_names.command(self.offload.spec, node, "robot"))

    def _run(self, name: str, words: Sequence[str]) -> None:
        program, script, *rest = words
        interpreter = sys.executable if program in ("python", "python3") else program
        # A module of an installed package (`python3 -m ...`) needs no path.
        command = [interpreter, script if script.startswith("-") else str(_script(script)), *rest]
        self._start(name, command, self.environment(), priority=NODE_PRIORITY)

    def _start(
        self, name: str, command: list[str], environment: Mapping[str, str], *, priority: int = 0
    ) -> subprocess.Popen[bytes]:
        log = self.folder / f"{name}.log"
        child = self.host.start(command, dict(environment), log, priority=priority)
        self._children[name] = child
        return child

    def running(self, name: str) -> bool:
        """Whether a process that was started here still runs."""
        child = self._children.get(name)
        return child is not None and child.poll() is None

    def log(self, name: str) -> str:
        """What a process has written."""
        path = self.folder / f"{name}.log"
        return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""

    def end(self, name: str, number: signal.Signals = signal.SIGTERM) -> None:
        """Ends one process and all that it has started: asked first, then killed."""
        child = self._children.pop(name, None)
        if child is None:
            return
        _signal_group(child, number)
        with suppress(subprocess.TimeoutExpired):
            child.wait(END_S)
        _signal_group(child, signal.SIGKILL)
        child.wait()

    def agent_pids(self) -> list[int]:
        """The agent's processes: the supervisor, and those that it started."""
        group = self._children["agent"].pid
        pids = [int(path.name) for path in Path("/proc").glob("[0-9]*")]
        return [pid for pid in pids if _in_group(pid, group)]

    def power_off(self) -> None:
        """Everything on the robot dies at once; its disk stays."""
        for name in list(self._children):
            self.end(name, signal.SIGKILL)

    # -- the recorder -------------------------------------------------------------------------------------------------

    @property
    def outputs(self) -> dict[str, str]:
        """The collected outputs with their types, without the accounts."""
        outputs = [output for _, output in self.offload.spec.collected_outputs]
        accounts = self.said.accounts.values()
        return {output.topic: output.type or "" for output in outputs if output.topic not in accounts}

    def listen(self, link: LinkOptions | None = None) -> Consumer:
        """Starts the recorder; it hears from now on and writes from `begin` on.

        Args:
            link: what `begin` shall do with the wire; None: nothing.
        """
        file = self.folder / "recording.jsonl"
        command = Consumer.command(file, self.outputs, link, self.said.accounts)
        log = self.folder / "recorder.log"
        child = self.host.start(command, self.environment(), log, piped=True, priority=RECORDER_PRIORITY)
        threshold_ms = self.offload.spec.switching.latency.allowed_loop_ms
        self.consumer = Consumer(child, file, tuple(self.outputs), threshold_ms)
        self.link = link
        if link is not None:
            self.host.wire.follow(link)
        return self.consumer

    def begin(self) -> float:
        """From now on it counts: the recording begins, and with it the schedule of the link. Returns the moment."""
        assert self.consumer is not None, "listen() comes first"
        start_s = self.host.wire.start_schedule() if self.link else steady_s()
        self.consumer.begin(recording.of_run(self.offload.spec, "offload", 0, start_s))
        self._begun_s = start_s
        return start_s

    def finish(self) -> Measures:
        """Ends the recording and measures it."""
        assert self.consumer is not None
        self._quieten()
        self.consumer.end(steady_s())
        shutil.copy2(self.consumer.file, self.folder / "last-recording.jsonl")
        measures = measure(recording.read(self.consumer.file))
        self.consumer = None
        return measures

    def _quieten(self) -> None:
        """Ends the schedule of the link: from now on the link is as it is before its schedule starts."""
        if self.link is not None:
            self.host.wire.follow(self.link)
            self.link = None

    # -- following it -------------------------------------------------------------------------------------------------

    @property
    def site(self) -> str:
        """The side in charge, as announced on the robot; empty: nothing was announced yet."""
        assert self.consumer is not None
        placement = self.consumer.watch.placement
        return placement.site if placement else ""

    def heard(self, site: str) -> int:
        """Messages of one side that the recorder has heard so far."""
        assert self.consumer is not None
        return self.consumer.heard.get(site, 0)

    def until(self, condition: Callable[[], bool], what: str, patience_s: float = 60.0) -> None:
        """Waits for something that the recorder hears; the agent's last words are told when it does not come."""
        assert self.consumer is not None

        def instead() -> str:
            assert self.consumer is not None
            watch = self.consumer.watch
            last = "\n".join(self.log("agent").splitlines()[-8:])
            return f"placement {watch.placement}, nodes {watch.nodes}, heard {watch.received}; the agent said:\n{last}"

        self.consumer.until(condition, what, patience_s, instead)

    def until_site(self, site: str, patience_s: float = SITE_S) -> None:
        """Waits until a side is in charge."""
        self.until(lambda: self.site == site, f"the {site} in charge of {self.name}", patience_s)

    def rest(self, seconds: float) -> None:
        """Lets time pass; fails at once when the agent has ended."""
        end_s = steady_s() + seconds
        while (left_s := end_s - steady_s()) > 0:
            assert self.running("agent"), f"the robot's agent has ended:\n{self.log('agent')[-2000:]}"
            assert self.consumer is not None
            self.consumer.rest(min(left_s, 0.5))

    def stop(self) -> None:
        """Ends everything on the robot; legal at any time."""
        self._quieten()
        if self.consumer:
            self.consumer.kill()
            self.consumer = None
        for name in list(self._children):
            self.end(name)


def _made(folder: Path, said: Showcase) -> dict[str, str]:
    """Variables of processes that find the interface packages of an example; makes the packages once."""
    if not said.interfaces:
        return {}
    from robot_offload_lab.run import interfaces

    return interfaces.environment(*(interfaces.cached(interfaces.read(folder / name)) for name in said.interfaces))


def _script(name: str) -> Path:
    """A program of the examples or of the end-to-end suite."""
    for folder in (*(each for each in EXAMPLES.iterdir() if each.is_dir()), APPS):
        if (folder / name).exists():
            return folder / name
    raise AssertionError(f"no example is called {name}")


def _in_group(pid: int, group: int) -> bool:
    try:
        return os.getpgid(pid) == group
    except ProcessLookupError:
        return False


def _signal_group(child: subprocess.Popen[bytes], number: signal.Signals) -> None:
    try:
        os.killpg(child.pid, number)
    except (ProcessLookupError, PermissionError):
        return
