"""The reporter's settings from its environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from robot_offload.errors import InputError


@dataclass(frozen=True, slots=True)
class Offered:
    """Source and target of the run-time settings.

    Attributes:
        name: of the ConfigMap.
        mounted: the ConfigMap's entry as the kubelet provides it.
        file: watched by the agent.
        answer: file for the answer to the robot's request for a certificate; its name is the entry's key.
    """

    name: str
    mounted: Path
    file: Path
    answer: Path


@dataclass(frozen=True, slots=True)
class ReporterSettings:
    """Names and places of the reporter.

    Attributes:
        namespace: of the Lease.
        lease: the name of the robot's Lease.
        robot: the robot's name, the holder of the Lease.
        state_file: written by the agent.
        handover_file: watched by the agent.
        handover_proof: the word that a handover request must carry.
        port: of the HTTP server.
        offered: the run-time settings that the agent offers to its robot; None: there are none.
    """

    namespace: str
    lease: str
    robot: str
    state_file: Path
    handover_file: Path
    handover_proof: str
    port: int = 8080
    offered: Offered | None = None


def read_settings(environment: Mapping[str, str]) -> ReporterSettings:
    """Read NAMESPACE, LEASE_NAME, ROBOT_NAME, STATE_FILE, HANDOVER_* and, if given, PORT, SETTINGS_*, ANSWER_FILE.

    Raises:
        InputError: one is missing or has no usable value.
    """
    wanted = ("NAMESPACE", "LEASE_NAME", "ROBOT_NAME", "STATE_FILE", "HANDOVER_FILE", "HANDOVER_PROOF")
    missing = [name for name in wanted if not environment.get(name)]
    if missing:
        raise InputError(f"the environment lacks {', '.join(missing)}; the operator's Deployment sets them")
    port = environment.get("PORT") or "8080"
    if not port.isdecimal() or int(port) > 65535:
        raise InputError(f"PORT: {port!r} is not a valid port; write a number from 0 (any free one) to 65535")
    return ReporterSettings(
        namespace=environment["NAMESPACE"],
        lease=environment["LEASE_NAME"],
        robot=environment["ROBOT_NAME"],
        state_file=Path(environment["STATE_FILE"]),
        handover_file=Path(environment["HANDOVER_FILE"]),
        handover_proof=environment["HANDOVER_PROOF"],
        port=int(port),
        offered=_offered(environment),
    )


def _offered(environment: Mapping[str, str]) -> Offered | None:
    values = [environment.get(name) for name in ("SETTINGS_NAME", "SETTINGS_MOUNTED", "SETTINGS_FILE", "ANSWER_FILE")]
    if not all(values):
        return None
    name, *files = (value or "" for value in values)
    return Offered(name, *map(Path, files))
