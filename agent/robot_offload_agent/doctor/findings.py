"""Findings of the doctor, and how they are shown."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from enum import Enum


class Level(str, Enum):
    """How much a finding matters."""

    OK = "ok"
    UNKNOWN = "unknown"
    WARNING = "warning"
    ERROR = "error"

    def __str__(self) -> str:
        return self.value


class Check(str, Enum):
    """What the doctor checks; a word never changes its meaning."""

    BONDS = "Bonds"
    CERTIFICATES = "Certificates"
    CLOCK = "Clock"
    CLOUD_TCP = "CloudTcp"
    CLOUD_UDP = "CloudUdp"
    DDS_DISCOVERY = "DdsDiscovery"
    FILE_DESCRIPTORS = "FileDescriptors"
    IN_FLIGHT = "InFlight"
    MESSAGE_TYPES = "MessageTypes"
    MIDDLEWARE = "Middleware"
    NODES = "Nodes"
    RELEASES = "Releases"
    REALTIME_PRIORITY = "RealtimePriority"
    RECEIVE_BUFFER = "ReceiveBuffer"
    RECORDING = "Recording"
    ROS_ENVIRONMENT = "RosEnvironment"
    ROS_GRAPH = "RosGraph"
    SECOND_LIFECYCLE_MANAGER = "SecondLifecycleManager"
    SECOND_PUBLISHER = "SecondPublisher"
    SERVER_TIMEOUT = "ServerTimeout"
    UNDECLARED = "Undeclared"
    VERSIONS = "Versions"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Finding:
    """One thing that was checked.

    Attributes:
        check: what was checked.
        level: how much it matters.
        message: what was seen.
        step: what to do next; empty if nothing needs to be done.
    """

    check: Check
    level: Level
    message: str
    step: str = ""


def exit_code(findings: Iterable[Finding]) -> int:
    """Return 1 if an error is among the findings, else 0."""
    return int(any(finding.level is Level.ERROR for finding in findings))


def as_json(findings: Sequence[Finding]) -> str:
    """Return the findings as a JSON list, for programs."""
    return json.dumps([asdict(finding) for finding in findings], indent=1)


def as_text(findings: Sequence[Finding]) -> str:
    """Return the findings as text: first what needs action, then what is fine in one line, then what is in flight."""
    order = [Level.ERROR, Level.WARNING, Level.UNKNOWN]
    lines = []
    for finding in sorted((f for f in findings if f.level is not Level.OK), key=lambda f: order.index(f.level)):
        lines.append(f"{finding.level:8} {finding.check}: {finding.message}")
        if finding.step:
            lines.append(f"{'':8} next: {finding.step}")
    fine = [it.check for it in findings if it.level is Level.OK and it.check is not Check.IN_FLIGHT]
    if fine:
        lines.append(f"{Level.OK:8} {', '.join(fine)}")
    lines += [f"{finding.check}: {finding.message}" for finding in findings if finding.check is Check.IN_FLIGHT]
    return "\n".join(lines)
