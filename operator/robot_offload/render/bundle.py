"""The bundle: a folder with everything that the robot needs. It works offline afterwards, without typing addresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import yaml

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.errors import RobotOffloadError
from robot_offload.objects.parent import Parent
from robot_offload.objects.pod import TMP
from robot_offload.render import bundle_texts as texts
from robot_offload.render.agent_config import AgentSite, agent_config
from robot_offload.render.launch_file import LAUNCH_FILE, launch_file
from robot_offload.transport import dds_router, tunnel

PRIVATE_KEY: Final = "certificates/robot.key"
"""The only file that is readable by its owner alone."""
REALTIME_PRIORITY: Final = 20
"""The highest real-time priority that the agent may ask for; it uses less."""


class AddressPendingError(RobotOffloadError):
    """The cluster does not yet have the cloud's addresses for the robot."""


class CertificatesPendingError(RobotOffloadError):
    """The robot's certificate does not exist yet."""


@dataclass(frozen=True)
class BundleSecrets:
    """The robot's credentials, all PEM.

    Attributes:
        ca: certificates of the authority that signed the cloud's.
        certificate: the robot's.
        private_key: its key.
    """

    ca: bytes
    certificate: bytes
    private_key: bytes

    def __repr__(self) -> str:
        return "BundleSecrets(...)"  # a private key must not be logged


def default_folder(offload: RobotOffload) -> str:
    """Return the bundle's folder on the robot."""
    return f"/etc/robot-offload/{offload.metadata.name}"


def bundle(parent: Parent, secrets: BundleSecrets | None, *, folder: str = "") -> Mapping[str, bytes]:
    """Return the bundle's files by their paths.

    Args:
        parent: the resource.
        secrets: None if the transport needs none.
        folder: the bundle's future folder on the robot; empty: see `default_folder`.

    Raises:
        AddressPendingError: an address of the cloud is not known yet.
        CertificatesPendingError: the transport needs certificates, which do not exist yet.
    """
    missing = transport.missing_purposes(parent.offload, parent.facts.endpoints)
    if missing:
        raise AddressPendingError(
            f"{parent.name}: the cluster has given no address yet for {', '.join(missing)}; "
            "see the condition AddressesReady"
        )
    if transport.needs_certificates(parent.spec) and secrets is None:
        raise CertificatesPendingError(
            f"{parent.name}: the robot's certificate is not made yet; see the condition CertificatesReady"
        )
    place = folder or default_folder(parent.offload)
    chosen = transport.of(parent.spec)
    key = PRIVATE_KEY if transport.needs_certificates(parent.spec) else ""
    files = {
        "agent.yaml": agent_config(parent.offload, robot_site(parent, place)).encode(),
        "environment": _environment(parent).encode(),
        "robot-offload-agent.service": texts.agent_unit(
            parent.offload, place, REALTIME_PRIORITY, _agent_environment(parent), key
        ).encode(),
        **chosen.robot_files(parent.offload, parent.facts.endpoints, place, texts.state_dir(parent.name)),
        **_certificates(parent.offload, secrets),
    }
    if parent.spec.transport.type == "DDSRouter":
        files["robot-offload-router.service"] = texts.router_unit(parent.offload, place).encode()
        files["robot-offload-tunnel.service"] = texts.tunnel_unit(
            parent.offload, place, REALTIME_PRIORITY, key
        ).encode()
    files[LAUNCH_FILE] = launch_file(parent.offload, place).encode()
    files["compose.yaml"] = _compose(parent, place).encode()
    files["README.md"] = texts.readme(parent.offload, place, [*files, "README.md"]).encode()
    return dict(sorted(files.items()))


def robot_site(parent: Parent, folder: str) -> AgentSite:
    """Return the robot agent's site."""
    name = parent.name
    pulse = parent.facts.endpoints_for("pulse")
    certified = transport.needs_certificates(parent.spec)  # with DDSRouter the agent renews them for the tunnel
    return AgentSite(
        side="robot",
        host=pulse[0].host if pulse else "",
        ca=f"{folder}/certificates/ca.pem" if certified else "",
        certificate=f"{folder}/certificates/robot.pem" if certified else "",
        private_key=f"{folder}/{PRIVATE_KEY}" if certified else "",
        endpoints=parent.facts.endpoints,
        # Without a declared name the address may change; an authority for this robot alone is enough.
        verify_name=parent.spec.transport.expose.host is not None,
        peer_name=parent.certificate_name("cloud"),
        uid=parent.identity,
        runtime_dir=texts.runtime_dir(name),
        state_dir=texts.state_dir(name),
        realtime=True,
        generation=parent.facts.generation,
    )


def _certificates(offload: RobotOffload, secrets: BundleSecrets | None) -> dict[str, bytes]:
    if secrets is None or not transport.needs_certificates(offload.spec):
        return {}
    return {
        "certificates/ca.pem": secrets.ca,
        "certificates/robot.pem": secrets.certificate,
        PRIVATE_KEY: secrets.private_key,
    }


def robot_environment(parent: Parent) -> dict[str, str]:
    """Return the environment of the agent and of the robot's own nodes."""
    robot = parent.spec.robot
    return {
        "ROS_DOMAIN_ID": str(robot.domain_id),
        "RMW_IMPLEMENTATION": robot.rmw,
        **transport.of(parent.spec).robot_environment(parent.offload, parent.facts.endpoints),
    }


def _agent_environment(parent: Parent) -> dict[str, str]:
    """Return the variables of the agent alone; through discovery servers it must see the whole graph."""
    values = {"HOME": TMP, "ROS_LOG_DIR": TMP}
    by_servers = "ROS_DISCOVERY_SERVER" in robot_environment(parent)
    return {**values, "ROS_SUPER_CLIENT": "TRUE"} if by_servers else values


def _environment(parent: Parent) -> str:
    values = {**robot_environment(parent), texts.SETUP_VARIABLE: texts.setup_file(parent.offload)}
    return "".join(f"{name}={value}\n" for name, value in values.items())


def _compose(parent: Parent, folder: str) -> str:
    name = parent.name
    agent = {
        **agent_container(parent, ["robot-offload-agent", "robot", "--params", f"{folder}/agent.yaml"], folder),
        "env_file": ["environment"],
        "environment": {
            # A container has its own /dev/shm: with shared memory it would find the robot's nodes but hear nothing.
            "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
            **_agent_environment(parent),
            # The image knows its own folders; it does not contain the robot's.
            texts.SETUP_VARIABLE: "",
        },
        "volumes": [f".:{folder}:ro", f"state:{texts.state_dir(name)}"],
        "tmpfs": [TMP, texts.runtime_dir(name)],
    }
    services = {"agent": agent}
    if parent.spec.transport.type == "DDSRouter":
        command = ["ddsrouter", "-c", f"{folder}/{dds_router.ROBOT_FILE}"]
        services["router"] = {"image": parent.facts.images.router, "command": command, **container(folder)}
        command = [tunnel.PROGRAM, "--params", f"{folder}/{tunnel.FILE}"]
        # The agent renews the robot's certificate in its state folder.
        volumes = [f".:{folder}:ro", f"state:{texts.state_dir(name)}:ro"]
        services["tunnel"] = {**agent_container(parent, command, folder), "volumes": volumes}
    document = {"name": f"robot-offload-{name}", "services": services, "volumes": {"state": {}}}
    return yaml.safe_dump(document, sort_keys=False, width=1000)


def agent_container(parent: Parent, command: Sequence[str], folder: str) -> dict[str, Any]:
    """Return a service that may request real-time priority and read the private key, which only root may."""
    return {
        "image": parent.agent_image,
        "user": "root",
        "command": list(command),
        **container(folder),
        "cap_add": ["SYS_NICE"],
        "ulimits": {"rtprio": REALTIME_PRIORITY},
    }


def container(folder: str) -> dict[str, Any]:
    """Return the common part of all containers, on the robot's own network because of DDS."""
    return {
        "network_mode": "host",
        "restart": "unless-stopped",
        "read_only": True,
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges:true"],
        "tmpfs": [TMP],
        "volumes": [f".:{folder}:ro"],
    }
