"""A world for the tests of the agent: both agents, a replica of one node on each side, a link that can be cut.

Everything is real: the processes, ROS, the Zenoh sessions over an emulated link, or DDS between two network
namespaces. The test itself plays consumer, driver and sensors with a ROS node in each domain (`ears`).
"""

import datetime
import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import yaml
from std_msgs.msg import Header

from robot_offload.render.pki import CertificateSet
from robot_offload_agent.runtime.clock import now_s
from robot_offload_lab.judge.recording import Arrival, PlacementChange
from robot_offload_lab.run.certificates import CertificatePaths, make_certificates
from robot_offload_lab.wire.emulated import EmulatedWire, Forward, WireConfig
from tests.ros.agent.ears import INHIBIT, Driver, Ear, wait_until
from tests.ros.agent.far_ear import FarEar
from tests.ros.agent.namespaces import ADDRESSES, Namespaces
from tests.ros.agent.passage import ViolationError, violations
from tests.ros.agent.processes import Processes
from tests.ros.agent.routers import ENVIRONMENT, Routers
from tests.ros.ports import free_port

NODES = Path(__file__).with_name("nodes.py")
PATIENCE_S = 60.0
MAX_AGE_S = 0.25
MEASURING_S = 0.15
"""What the test's own process may add to an age on a busy machine."""
HEARD_S = 20.0
"""What was said is heard by then, also on a machine that is busy; who breaks no rule waits for nothing."""
COMMAND = "/command"
AUTHOR = "kubectl-edit at 2026-11-23T12:00:00Z"
"""Who changed the settings, as the operator writes it beside them."""
PROCESSES = {"robot": ("collector", "pulse", "control", "data"), "cloud": ("pulse", "control", "data")}

COMMON: dict[str, Any] = {
    "robot_name": "walker-1",
    "realtime": True,
    "loss_timeout_ms": 150.0,
    "lease_ms": 400.0,
    "max_command_age_ms": MAX_AGE_S * 1e3,
    "activation_deadline_ms": 300.0,
    "hold_down_initial_ms": 100.0,
    "hold_down_max_ms": 300.0,
    "flap_window_ms": 500.0,
    "inhibit_service": INHIBIT,
    "nodes": ["walker"],
    "node.walker.core": True,
    "node.walker.may_differ": ["rate_hz", "activation_s", "refuse", "padding"],
    "outputs": ["command"],
    "output.command.topic": COMMAND,
    "output.command.type": "std_msgs/msg/Header",
    "output.command.rate_hz": 20.0,
    "output.command.deadline_ms": 300.0,
    "output.command.robot_topic": "/offload/robot/command",
    "output.command.cloud_topic": "/offload/cloud/command",
    "output.command.node": "walker",
    "inputs": ["odom", "map"],
    "input.odom.topic": "/odom",
    "input.odom.max_age_ms": 400.0,
    "input.map.topic": "/map",
    "input.map.latched": True,
}
PATIENT: dict[str, Any] = {"loss_timeout_ms": 1500.0, "lease_ms": 2000.0}
"""Instead of COMMON's, where a beat that a busy machine delays is to end no stay."""
SERVED: dict[str, Any] = {
    "actions": ["count", "many"],
    "action.many.name": "/many",
    "action.many.type": "test_msgs/action/Fibonacci",
    "action.many.on_switch": "Resend",
    "action.many.node": "walker",
    "action.many.core": True,
    "action.count.name": "/count",
    "action.count.type": "test_msgs/action/Fibonacci",
    "action.count.on_switch": "Resend",
    "action.count.node": "walker",
    "action.count.core": True,
    "services": ["ask", "do", "detect"],
    "service.detect.name": "/detect",
    "service.detect.type": "std_srvs/srv/Trigger",
    "service.detect.of_cloud": True,
    "service.do.name": "/do",
    "service.do.type": "test_msgs/srv/BasicTypes",
    "service.do.node": "walker",
    "service.do.core": True,
    "service.ask.name": "/ask",
    "service.ask.type": "std_srvs/srv/Trigger",
    "service.ask.mode": "Idempotent",
    "service.ask.node": "walker",
    "service.ask.core": True,
    "used_services": ["lamp"],
    "used_service.lamp.name": "/lamp",
    "used_service.lamp.type": "std_srvs/srv/Trigger",
    "used_service.lamp.node": "walker",
    "used_actions": ["lift"],
    "used_action.lift.name": "/lift",
    "used_action.lift.type": "test_msgs/action/Fibonacci",
    "used_action.lift.node": "walker",
}


@dataclass(frozen=True)
class Plan:
    """How a world is to be.

    Attributes:
        domains: of robot and cloud; the same one twice for the ROS link.
        link: `zenoh`, `ros`, or `router` for topics over two DDS Routers.
        both, robot, cloud: parameters that differ from COMMON.
        fed: the robot's sensors publish from the start.
        serves: the replicas serve actions and services, see `counting.py`, and the agents relay them.
        program: what runs as the replica on each side.
        files: the cloud's agent has the files by which the operator meets it, see `offer`, `answer` and `state`.
        environment: of the agents, by side.
        plain: the replicas of `walker` have no lifecycle.
    """

    domains: tuple[int, int]
    link: str = "zenoh"
    both: dict[str, Any] = field(default_factory=dict)
    robot: dict[str, Any] = field(default_factory=dict)
    cloud: dict[str, Any] = field(default_factory=dict)
    fed: bool = True
    serves: bool = False
    program: Path = NODES
    files: bool = False
    environment: dict[str, dict[str, str]] = field(default_factory=dict)
    plain: bool = False


class World:
    """A context manager; `start_*` brings up what a test needs, leaving it ends everything and checks that."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.folder = Path(tempfile.mkdtemp(prefix="ro-"))  # short, because socket paths are limited to 107 characters
        self.domain = dict(zip(("robot", "cloud"), plan.domains, strict=True))
        self.processes = Processes(self.folder, {"ROS_LOG_DIR": str(self.folder)})
        self.agents: dict[str, subprocess.Popen[bytes]] = {}
        self.nodes: dict[str, subprocess.Popen[bytes]] = {}
        self.begun_s: list[float] = []  # when the robot's control was started anew
        self.ear: Any = None  # an Ear, or a FarEar over DDS
        self.cloud: Ear | None = None
        self.namespaces = Namespaces() if plan.link != "zenoh" else None
        self.routers: Routers | None = None
        self.wire: EmulatedWire | None = None
        self.ports: dict[str, int] = {}
        self.certificates: CertificatePaths | None = None

    # -- up and down --------------------------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        try:
            self._open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            sys.stderr.write(self.processes.logs())
        self.close()

    def _open(self) -> None:
        if self.plan.link != "ros":
            hosts = ["127.0.0.1"]
            now = datetime.datetime.now(datetime.timezone.utc)
            self.certificates = make_certificates(self.folder / "pki", robot="walker-1", host_names=hosts, now=now)
        if self.namespaces is not None:
            self.namespaces.make()
        else:
            self.ports = {name: free_port() for name in ("pulse", "data")}
            forwards = tuple(
                Forward(f"{name}-{protocol}", protocol, "127.0.0.1:0", f"127.0.0.1:{port}")
                for name, port in self.ports.items()
                for protocol in ("udp", "tcp")
            )
            self.wire = EmulatedWire(WireConfig(forwards, realtime=True))
            self.wire.start()
        if self.plan.link == "router":
            assert self.certificates is not None
            self.routers = Routers(self.processes, self.folder, self.plan.domains, self.certificates)
            spaces = {side: self.namespace(side) for side in ADDRESSES}
            self.routers.start(spaces, ADDRESSES["cloud"].partition("/")[0])
        if self.namespaces is not None:
            self.ear = FarEar(self.processes, self.domain["robot"], self.namespace("robot"), COMMAND)
        else:
            self.ear = ear = Ear(self.domain["robot"], "ear")
            self.odom = ear.feed("/odom", 20.0)
            self.map = ear.latch("/map", "a map")
            if not self.plan.fed:
                self.odom.cancel()
        self.driver = Driver(self.ear.arrivals(COMMAND), self.ear.inhibit_orders(INHIBIT))
        self.arrivals: list[Arrival] = self.driver.arrivals
        self.placed: list[PlacementChange] = self.ear.placements()

    def close(self) -> None:
        """Ends everything; the test's own nodes first.

        A process that is killed while it holds the shared memory of a participant of ours makes Fast DDS 2.14 map that
        anew, and a participant that is deleted meanwhile ends this whole process with SIGSEGV.
        """
        for ear in (self.ear, self.cloud):
            if ear is not None:
                ear.close()
        left = self.processes.close()
        if self.wire is not None:
            self.wire.stop()
        if self.namespaces is not None:
            self.namespaces.remove()
        shutil.rmtree(self.folder, ignore_errors=True)
        assert not left, f"left behind: {left}"

    def start(self) -> Self:
        """Everything, until the cloud acts."""
        for side in ("cloud", "robot"):
            self.start_agent(side)
            self.start_node(side)
        self.until(lambda: self.site == "cloud", "the cloud acts")
        return self

    def restore(self) -> None:
        """Puts a used world into order: everything runs, nothing is cut, no override; then the cloud acts."""
        self.cut(None)
        if self.wire is not None:
            self.wire.set(delay_ms=0)
        for side in ("cloud", "robot"):
            if self.agents[side].poll() is not None:
                self.start_agent(side)
            if self.nodes[side].poll() is not None:
                self.start_node(side)
        if self.namespaces is None:
            self.odom.reset()
        self.place("cloud")
        self.until(lambda: not self.driver.inhibited, "the driver is released")

    def cloud_ear(self) -> Ear:
        """A node in the cloud's domain, made when it is first needed."""
        if self.cloud is None:
            self.cloud = Ear(self.domain["cloud"], "cloud_ear")
        return self.cloud

    def namespace(self, side: str) -> str:
        return self.namespaces.name(side) if self.namespaces is not None else ""

    # -- the agents ---------------------------------------------------------------------------------------------------

    def parameters(self, side: str) -> dict[str, Any]:
        own = self.plan.robot if side == "robot" else self.plan.cloud
        base = {
            "side": side, "uid": self.folder.name, "domain_id": self.domain[side],
            "runtime_dir": str(self.folder / side), "state_dir": str(self.folder / "state"),
        }  # fmt: skip
        if self.plan.files and side == "cloud":
            names = ("settings", "state", "handover", "certificate")
            base |= {f"{name}_file": str(self.folder / f"{name}.file") for name in names}
        served = SERVED if self.plan.serves else {}
        return {**COMMON, **base, **self._link(side), **served, **self.plan.both, **own}

    def _link(self, side: str) -> dict[str, Any]:
        if self.wire is None or self.certificates is None:
            return {"link.type": "ros"}
        found: dict[str, Any] = {"link.type": "zenoh", "link.fallback_after_ms": 60000.0}
        for name in ("pulse", "data"):
            for kind, scheme, protocol in (("endpoints", "quic", "udp"), ("fallback", "tls", "tcp")):
                port = self.wire.port(f"{name}-{protocol}") if side == "robot" else self.ports[name]
                host = "127.0.0.1" if side == "robot" else "0.0.0.0"
                found[f"link.{name}_{kind}"] = [f"{scheme}/{host}:{port}"]
        paths = self.certificates.robot if side == "robot" else self.certificates.cloud
        found.update({"link.ca": str(paths.ca), "link.certificate": str(paths.certificate)})
        peer = "cloud" if side == "robot" else "walker-1"
        return {**found, "link.private_key": str(paths.private_key), "link.peer_name": peer}

    def start_agent(
        self, side: str, name: str = "", options: Sequence[str] = (), namespace: str = "", **different: Any
    ) -> subprocess.Popen[bytes]:
        """Starts the agent of a side with these options; `name` and what follows are for a second one beside it."""
        values = {**self.parameters(side), **{key.replace("__", "."): value for key, value in different.items()}}
        path = self.folder / f"{name or side}.yaml"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
        command = [sys.executable, "-m", "robot_offload_agent.main", side, "--params", str(path), *options]
        environment = {**self._joined(side), **self.plan.environment.get(side, {})}
        process = self.processes.start(f"{name or side}-agent", command, namespace or self.namespace(side), environment)
        if not name:
            self.agents[side] = process
            if side == "robot":
                self.begun_s.append(now_s())
        return process

    def _joined(self, side: str) -> dict[str, str]:
        """How ROS on a side finds others."""
        return ENVIRONMENT[side] if self.routers is not None else {}

    def pid(self, side: str, process: str) -> int:
        """The living process of a side's agent; 0 while it is not there."""
        if process == "supervisor":
            return self.agents[side].pid
        try:
            return int((self.folder / side / f"{process}.pid").read_text())
        except (OSError, ValueError):
            return 0

    def signal(self, side: str, process: str, number: int) -> None:
        os.kill(self.pid(side, process), number)

    def kill(self, side: str, process: str) -> float:
        """kill -9 of one process; returns the moment."""
        at_s = now_s()
        self.signal(side, process, signal.SIGKILL)
        if (side, process) == ("robot", "control"):
            self.begun_s.append(at_s)
        return at_s

    def kill_agent(self, side: str) -> None:
        """kill -9 of a whole agent at once, as a loss of power would."""
        os.killpg(self.agents[side].pid, signal.SIGKILL)
        self.agents[side].wait(PATIENCE_S)

    # -- the user's nodes ---------------------------------------------------------------------------------------------

    def start_node(self, side: str, other: str = "", **parameters: Any) -> subprocess.Popen[bytes]:
        """Starts the replica of `walker` on a side, or beside it a node of another name that is no replica."""
        name = other or ("walker" if side == "robot" else "remote_walker")
        given = {"rate_hz": 20.0 if side == "robot" else 25.0, **parameters}
        topic = f"/{other}/command" if other else f"/offload/{side}/command"
        arguments = ["-r", f"walker:__node:={name}", "-r", f"/command:={topic}"]
        if self.plan.serves and not other:
            given["serves"] = True
            hidden = ("send_goal", "cancel_goal", "get_result", "feedback", "status")
            actions = (f"/{name}/_action/{part}" for name in ("count", "many") for part in hidden)
            for served in ("/ask", "/do", *actions):
                arguments += ["-r", f"{served}:=/offload/{side}{served}"]
        for key, value in given.items():
            arguments += ["-p", f"{key}:={str(value).lower() if isinstance(value, bool) else value}"]
        plain = ["--plain"] if self.plan.plain and not other else []
        command = [sys.executable, str(self.plan.program), *plain, "--ros-args", *arguments]
        environment = {"ROS_DOMAIN_ID": str(self.domain[side]), **self._joined(side)}
        process = self.processes.start(f"{side}-{other or 'node'}", command, self.namespace(side), environment)
        if not other:
            self.nodes[side] = process
        return process

    def kill_node(self, side: str) -> float:
        at_s = now_s()
        os.killpg(self.nodes[side].pid, signal.SIGKILL)
        self.nodes[side].wait(PATIENCE_S)
        return at_s

    # -- the link -----------------------------------------------------------------------------------------------------

    def cut(self, which: str | None) -> float:
        """Cuts a direction (`up` is robot to cloud), `both`, or with None nothing; returns the moment."""
        at_s = now_s()
        if self.wire is not None:
            self.wire.cut(which)  # type: ignore[arg-type]
        else:
            assert self.namespaces is not None
            self.namespaces.cut(which)
        return at_s

    # -- the operator's files ------------------------------------------------------------------------------------------

    def offer(self, generation: int, **different: Any) -> None:
        """Changes the settings that the cloud's agent is to offer to the robot."""
        values = {key.replace("__", "."): value for key, value in different.items()}
        settings = {"/**": {"ros__parameters": {"generation": generation, **values}}, "changed_by": AUTHOR}
        self._replace("settings", yaml.safe_dump(settings))

    def hand_over(self) -> str:
        """The pods are to go; returns the name of this end."""
        name = secrets.token_hex(8)
        self._replace("handover", name)
        return name

    def answer(self, text: str) -> None:
        """Gives the operator's answer to the robot's request for a certificate."""
        self._replace("certificate", text)

    def write_bundle(self, made: CertificateSet) -> None:
        """Writes certificates in place of those that both sides were to start with."""
        assert self.certificates is not None
        for paths, own, trusted in (
            (self.certificates.robot, made.robot, made.server_ca),
            (self.certificates.cloud, made.cloud, made.client_ca),
        ):
            paths.certificate.write_bytes(own.certificate)
            paths.private_key.write_bytes(own.private_key)
            paths.ca.write_bytes(trusted.certificate)

    def new_pod(self) -> None:
        """Starts the cloud's agent in a new pod, which has no handover file."""
        (self.folder / "handover.file").unlink(missing_ok=True)
        self.start_agent("cloud")

    def _replace(self, name: str, text: str) -> None:
        part = self.folder / f"{name}.new"
        part.write_text(text)
        part.replace(self.folder / f"{name}.file")

    @property
    def state(self) -> dict[str, Any]:
        """What the cloud's agent has told last; raises KeyError before that, as wait_until likes it."""
        try:
            found: dict[str, Any] = json.loads((self.folder / "state.file").read_text())
        except FileNotFoundError as error:
            raise KeyError("state") from error
        return found

    def audit_trail(self) -> list[str]:
        """The lines of the robot's audit trail."""
        files = sorted((self.folder / "state" / "audit").glob("audit-*.log"))
        return [line for file in files for line in file.read_text().splitlines(keepends=True)]

    # -- what is to be seen -------------------------------------------------------------------------------------------

    @property
    def site(self) -> str:
        """The side in charge, "" while the robot's newest control has not been heard yet."""
        heard = self.placed and (not self.begun_s or self.placed[-1].t_s > self.begun_s[-1])
        return self.placed[-1].site if heard else ""

    @property
    def reason(self) -> str:
        return self.placed[-1].reason if self.placed else ""

    @property
    def message(self) -> str:
        return self.placed[-1].message if self.placed else ""

    def until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
        """Waits for a condition; fails with what was waited for and all logs."""
        if not wait_until(condition, patience_s):
            told = "\n".join(map(str, self.placed[-12:]))
            raise AssertionError(f"not seen: {what}\n{told}\n{self.processes.logs()}")

    def passes(self, side: str, count: int = 3) -> None:
        """Waits until new messages of a side's replica have passed."""
        start = len(self.arrivals)
        self.until(
            lambda: sum(a.site == side for a in self.arrivals[start:]) >= count, f"{count} messages of the {side} pass"
        )

    def goes_to(self, side: str) -> None:
        """Waits until a side is in charge and its messages pass."""
        self.until(lambda: self.site == side, f"the {side} is in charge")
        self.passes(side)

    def override(self, word: str) -> None:
        """Sets the maintenance override."""
        result = self.ear.set_parameter("/cloud_switcher", "override", word)
        assert result.successful, result.reason

    def place(self, side: str, stay: bool = False) -> None:
        """Brings a side into charge by the override; `stay` leaves the override set."""
        self.override(side.capitalize())
        self.goes_to(side)
        if not stay:
            self.override("Auto")

    def check(self, since: int = 0) -> None:
        """The rules at the consumer for everything that passed since the `since`-th message."""
        if self.agents["robot"].poll() is None:
            self.until(lambda: self.site, "a word of the robot's newest control, which the rules refer to")
        passed, found = self.arrivals[since:], [""]

        def clean() -> bool:
            """An announcement may be heard after the message that it explains, but it is heard."""
            found[:] = violations(passed, self.placed, MAX_AGE_S + MEASURING_S, self.begun_s)
            return not found

        if not wait_until(clean, HEARD_S):
            raise ViolationError("\n".join([*found[:10], "said:", *map(str, self.placed[-20:])]))


def header_numbers(heard: list[tuple[float, Header]]) -> list[int]:
    """The feed's numbers of what was heard."""
    return [int(message.frame_id.partition("#")[2]) for _, message in heard]
