"""Two real DDS Routers, the tunnel between them and a discovery server, with the files that the product renders."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.objects.pod import CERTIFICATES_DIR
from robot_offload.transport import dds_router, tunnel
from robot_offload_lab.run.certificates import CertificatePaths
from tests.ros.agent.processes import Processes

VARIABLE = "DDSROUTER_BIN"
BINARY = os.environ.get(VARIABLE, "")
SERVER = "127.0.0.1:11811"
ENVIRONMENT = {
    "robot": {},
    "cloud": {
        "ROS_DISCOVERY_SERVER": SERVER,
        "ROS_SUPER_CLIENT": "TRUE",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    },
}
"""Of everything that speaks ROS on a side; in the cloud as in the pods."""


def resource(domains: tuple[int, int]) -> dict[str, Any]:
    """The resource of the walker, see `harness.COMMON`; /raw is an input without a consumer at the start."""
    output = {"topic": "/command", "type": "std_msgs/msg/Header", "rate": 20}
    return {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": "walker-1"},
        "spec": {
            "robot": {"domainID": domains[0]},
            "cloud": {"domainID": domains[1]},
            "transport": {"type": "DDSRouter"},
            "topics": {"toCloud": [{"name": "/odom"}, {"name": "/map"}, {"name": "/raw"}]},
            "nodes": [{"name": "walker", "placement": "Duplicated", "image": "walker:1", "outputs": [output]}],
        },
    }


class Routers:
    """What runs beside the agents of a world."""

    def __init__(
        self, processes: Processes, folder: Path, domains: tuple[int, int], certificates: CertificatePaths
    ) -> None:
        self.offload = parse_object(resource(domains), "walker")
        self.processes = processes
        self.folder = folder
        self.certificates = certificates
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self.own = ""  # where the robot's agent keeps the pair that it has renewed

    def start(self, spaces: dict[str, str], cloud_address: str) -> None:
        """Starts everything, in the network namespaces of both sides."""
        self.spaces, self.cloud_address = spaces, cloud_address
        host, _, port = SERVER.partition(":")
        server = Path(sys.executable).parent / "fast-discovery-server"
        self.run("cloud", "server", [str(server), "-i", "0", "-l", host, "-p", port])
        for part in ("router", "tunnel"):
            for side in ("cloud", "robot"):
                self.run_part(side, part)

    def run_part(self, side: str, part: str) -> None:
        """Starts the `router` or `tunnel` of a side with what the product renders for it."""
        if part == "router":
            cloud = side == "cloud"
            document = (
                dds_router.cloud_config(self.offload, ["127.0.0.1"]) if cloud else dds_router.robot_config(self.offload)
            )
            self.run(side, part, [BINARY, "-c", self.write(f"{side}-router.yaml", document)])
        else:
            file = self.write(f"{side}-tunnel.yaml", self._tunnel(side))
            self.run(side, part, [sys.executable, "-m", "robot_offload_agent.tunnel.main", "--params", file])

    def _tunnel(self, side: str) -> dict[str, Any]:
        if side == "cloud":
            document = tunnel.in_the_cloud("walker-1")
            names = {"ca.crt": "ca", "tls.crt": "certificate", "tls.key": "private_key"}
            own = self.certificates.cloud
            files = {f"{CERTIFICATES_DIR}/{name}": str(getattr(own, word)) for name, word in names.items()}
            return {key: files.get(str(value), value) for key, value in document.items()}
        own = self.certificates.robot
        files = tunnel.Proof(str(own.ca), str(own.certificate), str(own.private_key), self.own)
        return tunnel.robot_end("127.0.0.1:11667", [f"{self.cloud_address}:11666"], files, verify_name=False)

    def run(self, side: str, part: str, command: list[str]) -> None:
        """Starts a program on a side."""
        # The router has a Fast DDS of its own and must not find that of the wheels.
        libraries = {"server": library_path(), "router": ""}
        environment = {"LD_LIBRARY_PATH": libraries[part]} if part in libraries else {}
        name = f"{side}-{part}"
        self.running[name] = self.processes.start(name, command, self.spaces[side], environment)

    def restart(self, side: str, part: str) -> None:
        """Ends a part at once and starts it again."""
        self.kill(f"{side}-{part}")
        self.run_part(side, part)

    def kill(self, name: str) -> None:
        """kill -9 of one of them, `robot-router` for instance."""
        self.running[name].kill()
        self.running[name].wait(10.0)

    def write(self, name: str, document: dict[str, Any]) -> str:
        """Writes a file as the product does; returns its path."""
        path = self.folder / name
        path.write_text(dds_router.text(document), encoding="utf-8")
        return str(path)


def library_path() -> str:
    """Where the wheels keep the libraries of the discovery server."""
    root = Path(sys.executable).parent.parent
    return ":".join(str(path) for path in (root / "lib", *root.glob("lib/python*/site-packages/ros_fastrtps.libs")))
