"""Both sides without Kubernetes: a folder for the robot and one for a workstation in the cloud's role. Pure."""

from __future__ import annotations

import datetime
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import yaml

from robot_offload.api.v1alpha1 import Node, RobotOffload
from robot_offload.errors import InputError
from robot_offload.objects.facts import Endpoint, Facts, Images, Purpose
from robot_offload.objects.parent import Parent
from robot_offload.objects.pod import TMP
from robot_offload.objects.site import AgentSite
from robot_offload.render import bundle_texts as texts
from robot_offload.render.agent_config import agent_config
from robot_offload.render.bundle import (
    REALTIME_PRIORITY,
    BundleSecrets,
    agent_container,
    bundle,
    container,
    default_folder,
)
from robot_offload.render.pki import build_certificates
from robot_offload.render.ros_names import command, nodes_on
from robot_offload.transport import exposure

MAX_DOMAIN: Final = 101
"""The highest ROS domain whose ports are free on every system (ROS 2 documentation, "The ROS_DOMAIN_ID")."""
WORKSTATION_KEY: Final = "certificates/cloud.key"
_PURPOSES: Final[tuple[Purpose, ...]] = ("pulse", "data", "pulse-fallback", "data-fallback")


@dataclass(frozen=True, slots=True)
class Pairing:
    """The settings of one pair.

    Attributes:
        uid: of the pair: agents of another pair are ignored.
        host: DNS name or IP address by which the robot reaches the workstation.
        images: of our own programs.
        now: the present, with its time zone.
        days: validity of the certificates.
        robot_folder: the future place of the robot's folder; empty: that of a bundle.
        workstation_folder: the future place of the workstation's folder; empty: beside the other.
    """

    uid: str
    host: str
    images: Images
    now: datetime.datetime
    days: int
    robot_folder: str = ""
    workstation_folder: str = ""


@dataclass(frozen=True, slots=True)
class Pair:
    """The files of both folders by path."""

    robot: Mapping[str, bytes]
    workstation: Mapping[str, bytes]


def pair(offload: RobotOffload, pairing: Pairing) -> Pair:
    """Return both folders. They have new keys: after pairing again, copy both anew.

    Raises:
        InputError: the transport is not Zenoh, or the host is an IPv6 address.
        CertificateError: the host is neither a DNS name nor an IP address.
    """
    if offload.spec.transport.type != "Zenoh":
        kind = offload.spec.transport.type
        raise InputError(f"{offload.metadata.name}: spec.transport.type: {kind} needs a cluster; write Zenoh to pair")
    if exposure.is_ipv6(pairing.host):
        raise InputError(f"--host {pairing.host}: the workstation listens on IPv4; name an IPv4 address or a DNS name")
    alone = standalone(offload)
    facts = Facts(
        namespace=alone.metadata.namespace or "default",
        uid=pairing.uid,
        generation=0,
        images=pairing.images,
        nodes_wanted=True,
        endpoints=_endpoints(alone, pairing.host),
    )
    made = build_certificates(robot=alone.metadata.name, host_names=[pairing.host], now=pairing.now, days=pairing.days)
    parent = Parent(alone, facts)
    secrets = BundleSecrets(made.server_ca.certificate, made.robot.certificate, made.robot.private_key)
    return Pair(
        robot=bundle(parent, secrets, folder=pairing.robot_folder),
        workstation={
            **_workstation(parent, pairing.workstation_folder or f"{default_folder(alone)}-cloud"),
            "certificates/ca.pem": made.client_ca.certificate,
            "certificates/cloud.pem": made.cloud.certificate,
            WORKSTATION_KEY: made.cloud.private_key,
        },
    )


def standalone(offload: RobotOffload) -> RobotOffload:
    """Return the resource as it applies without a cluster.

    In one network both sides find each other by multicast, unless their ROS domains differ; and only `pair` signs
    certificates.
    """
    spec = offload.spec
    domain = spec.cloud_domain_id
    if domain == spec.robot.domain_id:
        domain = domain + 1 if domain < MAX_DOMAIN else domain - 1
    cloud = spec.cloud.model_copy(update={"domain_id": domain})
    certificates = spec.transport.certificates.model_copy(update={"issuer_ref": None})
    transport = spec.transport.model_copy(update={"certificates": certificates})
    return offload.model_copy(update={"spec": spec.model_copy(update={"cloud": cloud, "transport": transport})})


def _endpoints(offload: RobotOffload, host: str) -> tuple[Endpoint, ...]:
    block = offload.spec.transport.zenoh
    found = []
    for purpose in _PURPOSES:
        protocol, port = _PORTS[purpose]
        if protocol == "UDP" or block.fallback:
            found.append(Endpoint(purpose, protocol, host, getattr(block, port)))
    return tuple(found)


_PORTS: Final[Mapping[Purpose, tuple[Any, str]]] = {
    "pulse": ("UDP", "pulse_port"),
    "data": ("UDP", "data_port"),
    "pulse-fallback": ("TCP", "pulse_port"),
    "data-fallback": ("TCP", "data_port"),
}


def _workstation(parent: Parent, folder: str) -> dict[str, bytes]:
    name = texts.instance(parent.name, "cloud")
    site = AgentSite(
        side="cloud",
        host="0.0.0.0",  # noqa: S104 - clients without a certificate of this pair are refused
        ca=f"{folder}/certificates/ca.pem",
        certificate=f"{folder}/certificates/cloud.pem",
        private_key=f"{folder}/{WORKSTATION_KEY}",
        uid=parent.uid,
        runtime_dir=texts.runtime_dir(name),
        state_dir=texts.state_dir(name),
        realtime=True,
    )
    environment = {
        "ROS_DOMAIN_ID": str(parent.spec.cloud_domain_id),
        "RMW_IMPLEMENTATION": parent.spec.cloud_rmw,
        texts.SETUP_VARIABLE: texts.distro_setup_file(parent.offload),
    }
    own = {"HOME": TMP, "ROS_LOG_DIR": TMP}
    return {
        "agent.yaml": agent_config(parent.offload, site).encode(),
        "environment": "".join(f"{key}={value}\n" for key, value in environment.items()).encode(),
        "robot-offload-agent-cloud.service": texts.agent_unit(
            parent.offload, folder, REALTIME_PRIORITY, own, WORKSTATION_KEY, "cloud"
        ).encode(),
        "compose.yaml": _compose(parent, folder, name).encode(),
        "README.md": _readme(parent, folder).encode(),
    }


def _compose(parent: Parent, folder: str, name: str) -> str:
    words = ["robot-offload-agent", "cloud", "--params", f"{folder}/agent.yaml"]
    settings = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "HOME": TMP, "ROS_LOG_DIR": TMP, texts.SETUP_VARIABLE: ""}
    agent = {
        **agent_container(parent, words, folder),
        "env_file": ["environment"],
        "environment": settings,
        "volumes": [f".:{folder}:ro", f"state:{texts.state_dir(name)}"],
        "tmpfs": [TMP, texts.runtime_dir(name)],
    }
    services = {"agent": agent}
    for node in nodes_on(parent.spec, "cloud"):
        if node.image is not None and node.run is not None:
            services[f"node-{node.name.strip('/').replace('/', '-')}"] = {
                "image": node.image,
                "command": list(command(parent.spec, node, "cloud")),
                **container(folder),
                "volumes": [],
                "env_file": ["environment"],
                "environment": settings,
            }
    document = {"name": f"robot-offload-{name}", "services": services, "volumes": {"state": {}}}
    return yaml.safe_dump(document, sort_keys=False, width=1000)


def _readme(parent: Parent, folder: str) -> str:
    copy = f"sudo mkdir -p {folder} && sudo cp -r . {folder} && sudo chown -R root:root {folder}"
    start = f"""\
{copy}
sudo find {folder} ! -name '*.key' -exec chmod go+rX {{}} +
sudo cp {folder}/robot-offload-agent-cloud.service /etc/systemd/system/
sudo systemctl daemon-reload && sudo systemctl enable --now robot-offload-agent-cloud"""
    parts = [
        f"# Robot Offload: the workstation of {parent.name}",
        "It plays the cloud: no Kubernetes is needed. The same RobotOffload goes to a cluster later, unchanged.",
        texts.INSTALL,
        "## Start it",
        texts.fenced(start),
        f"""\
Or copy it with the first line, and start agent and replicas in containers: `cd {folder} && sudo docker compose up -d`.
The firewall must let {_listens(parent)} in, from the robot.""",
        f"""\
## Start the replicas

With the settings of `environment`. Its ROS domain, {parent.spec.cloud_domain_id}, is not the robot's: in one network
nodes of both sides would find each other.""",
        *(_replica(parent, node) for node in nodes_on(parent.spec, "cloud")),
        "Certificates end and are not renewed here: pair again before, and copy both folders.",
    ]
    return "\n\n".join(parts) + "\n"


def _replica(parent: Parent, node: Node) -> str:
    if node.run is None:
        return f"- `{node.name}`: has no `run` block, so the file does not say how it is started."
    return f"- `{node.name}`:\n\n{texts.fenced(shlex.join(command(parent.spec, node, 'cloud')))}"


def _listens(parent: Parent) -> str:
    block = parent.spec.transport.zenoh
    protocols = "UDP and TCP" if block.fallback else "UDP"
    return f"{protocols} {block.pulse_port} and {block.data_port}"
