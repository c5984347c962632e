"""The robot's computer: clock, limits, buffers, the shell's ROS settings, certificates."""

from __future__ import annotations

import ctypes
import os
import resource
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from robot_offload_agent.certificates.openssl import CertificateError
from robot_offload_agent.certificates.openssl import look as look_at_certificate
from robot_offload_agent.doctor.findings import Check, Finding, Level
from robot_offload_agent.link.certificate_files import certificate_problem
from robot_offload_agent.link.zenoh_configured import zenoh_settings
from robot_offload_agent.settings.parameters import Configuration

LEAST_FILES = 1024
LEAST_RECEIVE_BUFFER = 2 << 20
"""Two raw 640x480 images; one is 0.9 MB and comes in one burst."""
GOOD_RECEIVE_BUFFER = 8 << 20
REALTIME_PRIORITY = 20
"""The priority that the bundle's unit grants; the agent asks for less."""
SYS_NICE = 23
"""Bit of CAP_SYS_NICE in a capability set (linux/capability.h)."""
UNSYNCHRONISED = 0x40
"""STA_UNSYNC in the kernel's clock status (linux/timex.h)."""
CERTIFICATE_ENDS_S = 14 * 86400
RECEIVE_BUFFER_FILE = Path("/proc/sys/net/core/rmem_max")
CLOCK_STEP = "sudo apt install chrony; `chronyc tracking` shows the offset."


class _Timex(ctypes.Structure):
    """The beginning of the kernel's struct timex; the rest is padding."""

    _fields_ = (
        ("modes", ctypes.c_uint), ("offset", ctypes.c_long), ("freq", ctypes.c_long), ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long), ("status", ctypes.c_int), ("rest", ctypes.c_char * 256),
    )  # fmt: skip


@dataclass(frozen=True)
class Machine:
    """What was seen of this computer.

    Attributes:
        clock_error_s: possible error of the clock; None: no program sets it, or the kernel does not report it.
        open_files: file descriptors that one process may have.
        realtime: the highest real-time priority that this user's processes may take.
        receive_buffer: bytes that a socket may ask for; None: the system does not report it.
        environment: variables of this shell.
        records: the library that records changeovers is installed.
    """

    clock_error_s: float | None
    open_files: int
    realtime: int
    receive_buffer: int | None
    environment: Mapping[str, str]
    records: bool = True


def look() -> Machine:
    """Look at this computer only; change nothing."""
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    realtime, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    unlimited = realtime == resource.RLIM_INFINITY or _may_nice()
    try:
        buffer: int | None = int(RECEIVE_BUFFER_FILE.read_text())
    except (OSError, ValueError):
        buffer = None
    return Machine(
        clock_error_s=_clock_error_s(),
        open_files=1_000_000 if files == resource.RLIM_INFINITY else files,
        realtime=99 if unlimited else realtime,
        receive_buffer=buffer,
        environment=dict(os.environ),
        records=find_spec("mcap") is not None,
    )


def judge(machine: Machine, configuration: Configuration) -> Iterator[Finding]:
    """Return the problems of this computer. Pure."""
    yield _clock(machine.clock_error_s, configuration["max_clock_offset_ms"] / 1e3)
    yield _files(machine.open_files)
    yield _realtime(machine.realtime, configuration["realtime"])
    yield _buffer(machine.receive_buffer)
    yield from _environment(machine.environment, configuration["domain_id"])
    if configuration["record.switches"]:
        yield _recording(machine.records)


def certificates(configuration: Configuration, now_s: float | None = None) -> Iterator[Finding]:
    """Look at the certificate files of a Zenoh link.

    Args:
        configuration: of this side.
        now_s: the wall clock, seconds since 1970; None: this computer's.
    """
    if configuration["link.type"] != "zenoh":
        return
    settings = zenoh_settings(configuration, "pulse")
    step = "Copy the bundle anew (kubectl offload bundle NAME), and start doctor as the user that runs the agent."
    problem = certificate_problem(settings)
    if problem:
        yield Finding(Check.CERTIFICATES, Level.ERROR, problem, step)
        return
    try:
        seen = look_at_certificate(Path(settings.certificate))
    except CertificateError as error:
        yield Finding(Check.CERTIFICATES, Level.UNKNOWN, str(error), "sudo apt install openssl")
        return
    left_s = seen.end_s - (_wall_s() if now_s is None else now_s)
    end = time.strftime("%Y-%m-%d", time.gmtime(seen.end_s))
    if left_s < 0:
        message = f"the robot's certificate ended on {end}, or the clock is wrong"
        yield Finding(Check.CERTIFICATES, Level.ERROR, message, step)
    elif left_s < CERTIFICATE_ENDS_S:
        yield Finding(Check.CERTIFICATES, Level.WARNING, f"the robot's certificate ends on {end}", step)
    else:
        yield Finding(Check.CERTIFICATES, Level.OK, f"the robot's certificate lasts until {end}")


def _recording(installed: bool) -> Finding:
    if installed:
        return Finding(Check.RECORDING, Level.OK, "changeovers are recorded")
    step = "pip install 'robot-offload-agent[record]'"
    return Finding(Check.RECORDING, Level.WARNING, "no changeover is recorded: mcap is not installed", step)


def _clock(error_s: float | None, limit_s: float) -> Finding:
    limit = f"the cloud may act while the clocks differ by {limit_s * 1e3:g} ms at most"
    if error_s is None:
        return Finding(Check.CLOCK, Level.WARNING, f"nobody sets this computer's clock; {limit}", CLOCK_STEP)
    if error_s > limit_s:
        message = f"this computer's clock may be wrong by {error_s * 1e3:.0f} ms; {limit}"
        return Finding(Check.CLOCK, Level.WARNING, message, CLOCK_STEP)
    return Finding(Check.CLOCK, Level.OK, f"set by a time service, error below {error_s * 1e3:.1f} ms")


def _files(number: int) -> Finding:
    if number >= LEAST_FILES:
        return Finding(Check.FILE_DESCRIPTORS, Level.OK, f"{number} files a process")
    step = f"ulimit -n {4 * LEAST_FILES} in the shell that starts the agent, or LimitNOFILE= in its unit."
    message = f"a process may open {number} files; a large graph needs more"
    return Finding(Check.FILE_DESCRIPTORS, Level.WARNING, message, step)


def _realtime(priority: int, asked: bool) -> Finding:
    if priority >= REALTIME_PRIORITY:
        return Finding(Check.REALTIME_PRIORITY, Level.OK, "real-time priority may be taken")
    message = f"this user's real-time priority is {priority} at most; heartbeats come late on a busy board"
    step = "The bundle's systemd unit grants it; else /etc/security/limits.conf: @realtime - rtprio 20."
    return Finding(Check.REALTIME_PRIORITY, Level.WARNING if asked else Level.UNKNOWN, message, step)


def _buffer(size: int | None) -> Finding:
    if size is None:
        return Finding(Check.RECEIVE_BUFFER, Level.UNKNOWN, f"{RECEIVE_BUFFER_FILE} cannot be read")
    if size >= LEAST_RECEIVE_BUFFER:
        return Finding(Check.RECEIVE_BUFFER, Level.OK, f"net.core.rmem_max is {size} bytes")
    file = "/etc/sysctl.d/60-robot-offload.conf"
    step = f"echo net.core.rmem_max={GOOD_RECEIVE_BUFFER} | sudo tee {file}; sudo sysctl --system"
    return Finding(
        Check.RECEIVE_BUFFER,
        Level.WARNING,
        f"net.core.rmem_max is {size} bytes; bursts of images and clouds get lost",
        step,
    )


def _environment(environment: Mapping[str, str], domain: int) -> Iterator[Finding]:
    """Yield differences between the shell's ROS settings and the configuration."""
    step = "Source ROS 2 and load the bundle's file `environment`: set -a; . ./environment; set +a"
    if "ROS_DISTRO" not in environment:
        yield Finding(
            Check.ROS_ENVIRONMENT, Level.WARNING, "ROS_DISTRO is not set: no ROS 2 is sourced in this shell", step
        )
    found = environment.get("ROS_DOMAIN_ID") or "0"
    if found != str(domain):
        message = f"ROS_DOMAIN_ID is {found} in this shell and {domain} in the configuration"
        yield Finding(Check.ROS_ENVIRONMENT, Level.ERROR, message, step)
    discovery = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if environment.get("ROS_LOCALHOST_ONLY") == "1" or discovery in ("LOCALHOST", "OFF"):
        message = "discovery stays on this computer: nodes on the robot's other computers are not found"
        yield Finding(
            Check.DDS_DISCOVERY, Level.WARNING, message, "Fine on one computer; else unset ROS_LOCALHOST_ONLY."
        )
    middleware = environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    yield Finding(Check.MIDDLEWARE, Level.OK, f"{middleware}; the robot's own nodes must use the same")


def _clock_error_s() -> float | None:
    """Return the kernel's own estimate of the clock's error (adjtimex, read only)."""
    timex = _Timex()
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    except (OSError, AttributeError):
        return None
    if state < 0 or timex.status & UNSYNCHRONISED:
        return None
    return float(timex.esterror) / 1e6


def _may_nice() -> bool:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return bool(next(int(line.split()[1], 16) for line in lines if line.startswith("CapEff")) >> SYS_NICE & 1)
    except (OSError, StopIteration, ValueError, IndexError):
        return False


def _wall_s() -> float:
    return time.clock_gettime(time.CLOCK_REALTIME)
