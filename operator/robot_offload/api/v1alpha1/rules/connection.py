"""Rules about the connection of the two sides: transport, exposure, certificates, domains."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from robot_offload.api.v1alpha1.model import yaml_name
from robot_offload.api.v1alpha1.name_rules import cel_list
from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.api.v1alpha1.transport import BLOCKS, ONE_DOMAIN, Expose, TransportType
from robot_offload.findings import Finding

OWN_ANNOTATIONS: Final = "robotoffload.dev/"
"""The prefix of the annotations that the operator writes itself."""
_OWN_PORT: Final = 8080
"""Of the reporter, which listens in the same pod as the agent."""
# Linux hands out ephemeral ports from 32768 on; a domain from 102 on (7400 + 250 * 102 = 32900) can collide with
# them, up to where they end (60999, domain 214). Source: "The ROS_DOMAIN_ID" in the ROS 2 documentation.
_EPHEMERAL_DOMAINS: Final = range(102, 215)
_LAST_PORT: Final = 65535


def _block(block: str, types: tuple[TransportType, ...]) -> Rule:
    """Return a block of another type would be ignored, which nobody who writes one expects."""

    def broken(transport: Any) -> bool:
        return block in transport.model_fields_set and transport.type not in types

    return Rule(
        "spec.transport",
        "WrongBlock",
        f"!has(self.{yaml_name(block)}) || self.type in {cel_list(types)}",
        broken,
        f"{yaml_name(block)} belongs to transport type {' or '.join(types)}; remove it or change type",
        yaml_name(block),
        lambda transport: f"the type is {transport.type}",
    )


def _of_load_balancers(field: str) -> Rule:
    name = yaml_name(field)
    return Rule(
        "spec.transport.expose",
        "WrongExposure",
        f"self.type == 'LoadBalancer' || !has(self.{name})",
        lambda expose: getattr(expose, field) is not None and expose.type != "LoadBalancer",
        f"{name} belongs to type LoadBalancer; remove it or write type: LoadBalancer",
        name,
    )


def _not_ours(field: str) -> Rule:
    name = yaml_name(field)
    return Rule(
        "spec.transport.zenoh",
        "ReservedPort",
        f"self.{name} != {_OWN_PORT}",
        lambda zenoh: getattr(zenoh, field) == _OWN_PORT,
        f"port {_OWN_PORT} is taken by the reporter beside the agent; choose another one",
        name,
    )


RULES: Final[tuple[Rule, ...]] = (
    *(_block(block, types) for block, types in BLOCKS.items()),
    Rule(
        "spec.transport",
        "NoPeers",
        "self.type != 'StaticPeers' || (has(self.staticPeers) && has(self.staticPeers.robot) && "
        "size(self.staticPeers.robot) > 0)",
        lambda transport: transport.type == "StaticPeers" and not transport.static_peers.robot,
        "transport type StaticPeers needs at least one address of the robot, as the cloud reaches it: add "
        "staticPeers.robot",
        "staticPeers",
    ),
    Rule(
        "spec.transport.zenoh",
        "SamePort",
        "self.pulsePort != self.dataPort",
        lambda zenoh: zenoh.pulse_port == zenoh.data_port,
        "pulsePort and dataPort are the same port; give the data session another one",
        "dataPort",
    ),
    _not_ours("pulse_port"),
    _not_ours("data_port"),
    _of_load_balancers("address"),
    _of_load_balancers("load_balancer_class"),
    _of_load_balancers("source_ranges"),
    Rule(
        "spec.transport.expose",
        "WrongExposure",
        "self.type != 'ClusterIP' || !has(self.nodePorts)",
        lambda expose: expose.node_ports is not None and expose.type == "ClusterIP",
        "Services of type ClusterIP have no ports on the nodes; remove nodePorts or write type: NodePort",
        "nodePorts",
    ),
    Rule(
        "spec",
        "OutOfRange",
        "!has(self.transport.expose) || !has(self.transport.expose.nodePorts) || "
        "!has(self.transport.expose.nodePorts.discovery) || "
        f"self.transport.expose.nodePorts.discovery + self.cloud.discoveryServers <= {_LAST_PORT + 1}",
        lambda spec: any(port > _LAST_PORT for port in _discovery_ports(spec)),
        "each discovery server takes the next port after nodePorts.discovery, and the last one would be above "
        f"{_LAST_PORT}; write a lower port",
        "transport.expose.nodePorts.discovery",
    ),
    Rule(
        "spec.transport.certificates",
        "TooLong",
        "duration(self.renewBefore) < duration(self.duration)",
        lambda certificates: certificates.renew_before_ms >= certificates.duration_ms,
        "renewBefore is not less than duration, so certificates would be renewed all the time; write for example a "
        "third of duration",
        "renewBefore",
        lambda certificates: f"{text(certificates.renew_before_ms)} and {text(certificates.duration_ms)}",
    ),
    Rule(
        "spec",
        "DomainsDiffer",
        f"!(self.transport.type in {cel_list(ONE_DOMAIN)}) || !has(self.cloud.domainID) || "
        "self.cloud.domainID == self.robot.domainID",
        lambda spec: spec.transport.type in ONE_DOMAIN and spec.cloud_domain_id != spec.robot.domain_id,
        f"transport types {' and '.join(ONE_DOMAIN)} join both sides in one domain, but the robot's is another one; "
        "remove domainID under spec.cloud",
        "cloud.domainID",
        lambda spec: f"the robot's is {spec.robot.domain_id}",
    ),
)


def _discovery_ports(spec: RobotOffloadSpec) -> list[int]:
    """Return the ports of the cluster's nodes that discovery servers take, where the first one is given."""
    ports = spec.transport.expose.node_ports
    first = ports.discovery if ports else None
    return [] if first is None else [first + n for n in range(spec.cloud.discovery_servers)]


def node_ports_are_distinct(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A port of the nodes serves one purpose only."""
    expose: Expose = spec.transport.expose
    if expose.node_ports is None:
        return
    others = [port for name, port in expose.node_ports if port is not None and name != "discovery"]
    given = [*others, *_discovery_ports(spec)]
    if len(set(given)) < len(given):
        yield Finding(
            "spec.transport.expose.nodePorts",
            "SamePort",
            "gives one port twice (each discovery server takes the next one); a port of the nodes serves one purpose "
            "only",
        )


def annotations_are_not_ours(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """What the operator writes itself would be overwritten in silence."""
    for name in spec.transport.expose.annotations:
        if name.startswith(OWN_ANNOTATIONS):
            yield Finding(
                "spec.transport.expose.annotations",
                "ReservedAnnotation",
                f"{name!r} is written by the operator itself; remove it",
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


def strangers_are_kept_out(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Where nodes of both sides talk directly, DDS asks nobody who he is."""
    if spec.transport.type in ONE_DOMAIN:
        yield Finding(
            "spec.transport.type",
            "NobodyIsKeptOut",
            f"{spec.transport.type} neither encrypts nor authenticates: whoever reaches the network with domain "
            f"{spec.robot.domain_id} can drive this robot, another robot with this domain too; give each robot a "
            "network (VPN) or at least a domain of its own, or write type: Zenoh",
            "warning",
        )
