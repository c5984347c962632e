"""The checks of `doctor` on its own machine: limits, buffers, ports and the ROS environment."""

from __future__ import annotations

import os
import resource
import socket
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.cli.doctor.checks import LEAST_FILES, LEAST_RECEIVE_BUFFER, Finding

RECEIVE_BUFFER: Final = Path("/proc/sys/net/core/rmem_max")
REALTIME_LEAST: Final = 20
"""The priority that the agent's pulse process asks for."""
SYS_NICE: Final = 23
"""Bit of CAP_SYS_NICE in a capability set."""
DDS_BASE: Final = 7400
DDS_GAIN: Final = 250


@dataclass(frozen=True, slots=True)
class Machine:
    """This machine.

    Attributes:
        open_files: file descriptors that one process may have.
        realtime: the highest real-time priority that a process of this user may take; 99: any.
        receive_buffer: bytes that a socket may request; None: not known.
        environment: variables of this shell.
        busy_ports: UDP ports of the robot's ROS domain that cannot be bound.
    """

    open_files: int
    realtime: int
    receive_buffer: int | None
    environment: Mapping[str, str]
    busy_ports: tuple[int, ...] = ()


def look(domain_id: int | None = None) -> Machine:
    """Look at this machine.

    Args:
        domain_id: the robot's ROS_DOMAIN_ID, for its ports; None: ports are not checked.
    """
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    realtime, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    return Machine(
        open_files=1_000_000 if files == resource.RLIM_INFINITY else files,
        realtime=99 if realtime == resource.RLIM_INFINITY or _may_nice() else realtime,
        receive_buffer=_number(RECEIVE_BUFFER),
        environment=dict(os.environ),
        busy_ports=() if domain_id is None else tuple(_busy(domain_id)),
    )


def judge(machine: Machine, offload: RobotOffload | None) -> Iterator[Finding]:
    """Yield the problems of this machine. Pure.

    Args:
        machine: from `look`.
        offload: for the robot's ROS settings; None: checks that depend on them are skipped.
    """
    yield _files(machine.open_files)
    yield _realtime(machine.realtime)
    yield _buffer(machine.receive_buffer)
    if offload is not None:
        yield from _ros(machine.environment, offload)
        yield from _ports(machine.busy_ports)


def _files(number: int) -> Finding:
    if number < LEAST_FILES:
        return Finding(
            "FileDescriptors", "warning", f"a process may open {number} files; a large ROS graph needs more",
            f"ulimit -n {4 * LEAST_FILES} in the shell that starts the agent, or LimitNOFILE= in its unit.",
        )  # fmt: skip
    return Finding("FileDescriptors", "ok", f"{number} files a process")


def _realtime(priority: int) -> Finding:
    if priority < REALTIME_LEAST:
        return Finding(
            "RealtimePriority", "warning",
            f"a process may take real-time priority {priority} at most; on a busy machine heartbeats may come late",
            "The bundle's systemd unit grants it (LimitRTPRIO); else /etc/security/limits.conf: @realtime - rtprio 20.",
        )  # fmt: skip
    return Finding("RealtimePriority", "ok", "real-time priority may be taken")


def _buffer(size: int | None) -> Finding:
    if size is None:
        return Finding("ReceiveBuffer", "unknown", f"{RECEIVE_BUFFER} cannot be read")
    if size < LEAST_RECEIVE_BUFFER:
        return Finding(
            "ReceiveBuffer", "warning", f"net.core.rmem_max is {size} bytes; bursts of large messages get lost",
            f"sysctl -w net.core.rmem_max={4 * LEAST_RECEIVE_BUFFER}, and the same in /etc/sysctl.d.",
        )  # fmt: skip
    return Finding("ReceiveBuffer", "ok", f"net.core.rmem_max is {size} bytes")


def _ros(environment: Mapping[str, str], offload: RobotOffload) -> Iterator[Finding]:
    """Compare the shell's ROS settings with the robot's; a shell without ROS is not on a robot and is skipped."""
    robot = offload.spec.robot
    if "ROS_DISTRO" not in environment:
        return
    wanted = {"ROS_DISTRO": robot.ros_distro, "RMW_IMPLEMENTATION": robot.rmw, "ROS_DOMAIN_ID": str(robot.domain_id)}
    defaults = {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_DOMAIN_ID": "0"}
    for name, value in wanted.items():
        found = environment.get(name) or defaults.get(name, "")
        if found != value:
            yield Finding(
                "RosEnvironment",
                "error",
                f"{name} is {found} in this shell and {value} in the RobotOffload",
                f"export {name}={value} where the robot's nodes start, or correct spec.robot.",
            )
    kind = offload.spec.transport.type
    if environment.get("ROS_LOCALHOST_ONLY") == "1" and kind in ("DiscoveryServer", "StaticPeers"):
        yield Finding(
            "RosEnvironment",
            "error",
            f"ROS_LOCALHOST_ONLY=1 keeps DDS on this machine, and transport {kind} needs the network",
            "unset ROS_LOCALHOST_ONLY",
        )


def _ports(busy: tuple[int, ...]) -> Iterator[Finding]:
    """Yield busy ports of the first participants; DDS takes the next ones, so only a row of busy ports matters."""
    if len(busy) >= 8:
        yield Finding(
            "Ports",
            "warning",
            f"UDP ports {busy[0]} to {busy[-1]} of this ROS domain are taken",
            "Another program or another ROS domain uses them: ss -ulnp shows which; or choose another domainID.",
        )
    else:
        yield Finding("Ports", "ok", "the UDP ports of this ROS domain are free enough")


def tcp_problem(host: str, port: int, timeout_s: float = 3.0) -> str:
    """Return why a TCP port does not answer from here; empty if it does."""
    try:
        socket.create_connection((host, port), timeout_s).close()
    except OSError as error:
        return error.strerror or str(error) or type(error).__name__
    return ""


def _busy(domain_id: int) -> Iterator[int]:
    """Yield unicast discovery ports of the first ten participants of a domain that cannot be bound."""
    for participant in range(10):
        port = DDS_BASE + DDS_GAIN * domain_id + 10 + 2 * participant
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                yield port


def _may_nice() -> bool:
    """Return whether this process may take any priority."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        effective = next(line.split()[1] for line in lines if line.startswith("CapEff:"))
    except (OSError, StopIteration, IndexError):
        return os.geteuid() == 0
    return bool(int(effective, 16) >> SYS_NICE & 1)


def _number(file: Path) -> int | None:
    try:
        return int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
