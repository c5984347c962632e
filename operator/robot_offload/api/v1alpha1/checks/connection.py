"""Rules about the connection of the two sides: transport, exposure, certificates, domains."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.api.v1alpha1.model import yaml_name
from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.transport import BLOCKS, ONE_DOMAIN
from robot_offload.findings import Finding

# Linux hands out ephemeral ports from 32768 on; a domain from 102 on (7400 + 250 * 102 = 32900) can collide with
# them, up to where they end (60999, domain 214). Source: "The ROS_DOMAIN_ID" in the ROS 2 documentation.
_EPHEMERAL_DOMAINS: Final = range(102, 215)


def transport_block_fits_type(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A block of another type would be ignored, which nobody who writes one expects."""
    transport = spec.transport
    for block, types in BLOCKS.items():
        if block in transport.model_fields_set and transport.type not in types:
            yield Finding(
                f"spec.transport.{yaml_name(block)}",
                "WrongBlock",
                f"does not belong to transport type {transport.type}; remove it or write type: {' or '.join(types)}",
            )
    if transport.type == "StaticPeers" and not transport.static_peers.robot:
        yield Finding(
            "spec.transport.staticPeers.robot",
            "NoPeers",
            "transport type StaticPeers needs at least one address of the robot, as the cloud reaches it",
        )


def exposure_is_consistent(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """What only one type of Service has, and ports that two listeners would share."""
    transport = spec.transport
    expose, path = transport.expose, "spec.transport.expose"
    for field in ("address", "load_balancer_class"):
        if getattr(expose, field) is not None and expose.type != "LoadBalancer":
            yield Finding(
                f"{path}.{yaml_name(field)}",
                "WrongExposure",
                f"belongs to type LoadBalancer, but the type is {expose.type}; remove it or write type: LoadBalancer",
            )
    if expose.node_ports is not None and expose.type == "ClusterIP":
        yield Finding(
            f"{path}.nodePorts",
            "WrongExposure",
            "Services of type ClusterIP have no ports on the nodes; remove it or write type: NodePort",
        )
    if transport.zenoh.pulse_port == transport.zenoh.data_port:
        yield Finding(
            "spec.transport.zenoh.dataPort",
            "SamePort",
            f"{transport.zenoh.data_port} is the port of the pulse as well; give the data session another one",
        )
    if expose.node_ports is not None:
        given = [port for port in expose.node_ports.model_dump().values() if port is not None]
        if len(set(given)) < len(given):
            yield Finding(
                f"{path}.nodePorts", "SamePort", "gives one port twice; a port of the nodes serves one purpose only"
            )


def certificates_are_renewed_in_time(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A new certificate must not be due for renewal at once."""
    certificates = spec.transport.certificates
    if certificates.renew_before_ms >= certificates.duration_ms:
        yield Finding(
            "spec.transport.certificates.renewBefore",
            "TooLong",
            f"{text(certificates.renew_before_ms)} is not less than duration {text(certificates.duration_ms)}, so "
            "certificates would be renewed all the time; write for example a third of duration",
        )


def domains_are_one_where_they_must(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Without a link of the agents' own, nodes of different domains never meet."""
    if spec.transport.type in ONE_DOMAIN and spec.cloud_domain_id != spec.robot.domain_id:
        yield Finding(
            "spec.cloud.domainID",
            "DomainsDiffer",
            f"transport type {spec.transport.type} joins both sides in one domain, but the robot's is "
            f"{spec.robot.domain_id}; remove it",
        )


def domains_avoid_ephemeral_ports(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A domain whose ports the system hands out to others works on most days only."""
    for path, domain in (("robot", spec.robot.domain_id), ("cloud", spec.cloud.domain_id)):
        if domain in _EPHEMERAL_DOMAINS:
            yield Finding(
                f"spec.{path}.domainID",
                "EphemeralPorts",
                f"the ports of domain {domain} can collide with those that Linux hands out; use 0 to 101",
                "warning",
            )
