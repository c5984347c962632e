"""Two real DDS Routers and the tunnel between them, where this machine has a router: `DDSROUTER_BIN` names it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from robot_offload.transport import dds_router, dds_router_xml, tunnel
from robot_offload.transport import dds_router_config as router
from robot_offload_lab.run.certificates import CertificatePaths, SidePaths
from robot_offload_lab.run.free import HOST, free_ports
from robot_offload_lab.run.processes import Program

if TYPE_CHECKING:
    from robot_offload_lab.run.system import System

VARIABLE: Final = "DDSROUTER_BIN"
ROUTER_PRIORITY: Final = 5
"""As in the bundle's unit, and as the tunnel requests."""
_NAMES: Final = {"robot": router.ROBOT, "cloud": router.CLUSTER}


def binary() -> str:
    """Return the path of the DDS Router; empty: this machine has none."""
    return os.environ.get(VARIABLE, "")


def programs(system: System, certificates: CertificatePaths) -> Iterator[Program]:
    """Yield router and tunnel of both sides, and write their files.

    The connection of the tunnel goes through the emulated link's port for data over TCP.
    """
    # The agents have no sessions of their own, so the ports of the pulse are unused.
    meeting, listening = system.served[0], free_ports()[0][0]
    dialled, served = (f"{HOST}:{ports[1]}" for ports in (system.dialled, system.served))
    router_address, proof = f"{dds_router_xml.HOST}:{listening}", _proof(certificates.cloud)
    cloud = tunnel.cloud_end(served, router_address, proof, system.offload.metadata.name)
    robot = tunnel.robot_end(
        f"{dds_router_xml.HOST}:{meeting}", [dialled], _proof(certificates.robot), verify_name=True
    )
    sides = zip(_NAMES.items(), system.domains, (0, listening), (robot, cloud), strict=True)
    for (side, name), domain, port, end in sides:
        local = {"name": name, "kind": "local", "domain": domain, "transport": "udp"}
        xml = dds_router_xml.profile(listening=port, meeting=meeting)
        file = _write(system.out / f"{side}-router.yaml", dds_router.configuration(system.offload, local, xml))
        yield Program(
            f"{side}-router",
            (binary(), "-c", str(file)),
            system.out,
            {"HOME": str(system.temporary)},
            priority=ROUTER_PRIORITY if system.realtime else 0,
        )
        file = _write(system.out / f"{side}-tunnel.yaml", {**end, "realtime": system.realtime})
        command = (sys.executable, "-m", "robot_offload_agent.tunnel.main", "--params", str(file))
        yield Program(f"{side}-tunnel", command, system.out, dict(os.environ))


def _proof(files: SidePaths) -> tunnel.Proof:
    return tunnel.Proof(str(files.ca), str(files.certificate), str(files.private_key))


def _write(file: Path, document: dict[str, Any]) -> Path:
    file.write_text(dds_router.text(document), encoding="utf-8")
    return file
