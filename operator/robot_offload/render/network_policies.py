"""The network policies of a RobotOffload: default deny both ways for our pods, then what is declared."""

from __future__ import annotations

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects import child_names
from robot_offload.objects import policy_rules as rules
from robot_offload.objects.child_names import child_name
from robot_offload.objects.facts import Facts, Manifest
from robot_offload.objects.labels import instance_labels, selector
from robot_offload.render import handover
from robot_offload.render.build_job import build_ports
from robot_offload.transport import discovery


def network_policies(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """One policy per component that has pods."""
    found = [_agent(offload, facts), _nodes(offload, facts)]
    if transport.discovery_servers(offload.spec):
        found.append(_discovery(offload, facts))
    if offload.spec.built_nodes:
        found.append(_builds(offload, facts))
    return (*found, *transport.of(offload.spec).policies(offload, facts))


def _name(offload: RobotOffload, word: str) -> str:
    return child_name(offload.metadata.name, word)


def _agent(offload: RobotOffload, facts: Facts) -> Manifest:
    chosen = transport.of(offload.spec)
    incoming, outgoing = rules.dds_both_ways(offload, robot=chosen.traits.robot_speaks_dds)
    handing_over = rules.coming_from(selector(offload, "node"), rules.port("TCP", handover.PORT))
    ports = [rules.port(one.protocol, one.number) for one in transport.agent_ports(offload)]
    # The robot comes through NAT from anywhere; that it is the robot is proven by its certificate.
    robot = [rules.anybody(*ports)] if ports else []
    return rules.policy(
        offload,
        facts,
        _name(offload, child_names.AGENT),
        "agent",
        ingress=[*robot, handing_over, *incoming],
        egress=[rules.names(), *outgoing, *_to_servers(offload), rules.kubernetes_api()],
    )


def _nodes(offload: RobotOffload, facts: Facts) -> Manifest:
    incoming, outgoing = rules.dds_both_ways(offload, robot=transport.of(offload.spec).traits.robot_speaks_dds)
    handing_over = rules.going_to(selector(offload, "agent"), rules.port("TCP", handover.PORT))
    return rules.policy(
        offload,
        facts,
        _name(offload, child_names.NODES),
        "node",
        ingress=incoming,
        egress=[rules.names(), *outgoing, *_to_servers(offload), handing_over],
    )


def _discovery(offload: RobotOffload, facts: Facts) -> Manifest:
    robot = transport.of(offload.spec).traits.robot_speaks_dds
    # A server answers to the ports that a participant has announced, not to where its question came from.
    incoming, outgoing = rules.dds_both_ways(offload, robot=robot)
    port = rules.port(discovery.PORT.protocol, discovery.PORT.number)
    asking = rules.anybody(port) if robot else rules.coming_from(instance_labels(offload), port)
    return rules.policy(
        offload,
        facts,
        _name(offload, child_names.DISCOVERY),
        "discovery",
        ingress=[asking, *incoming],
        egress=[rules.names(), *outgoing],
    )


def _builds(offload: RobotOffload, facts: Facts) -> Manifest:
    # Sources, packages and base images come from hosts that no label tells; the ports are known.
    ports = [rules.port("TCP", number) for number in build_ports(offload.spec)]
    return rules.policy(
        offload,
        facts,
        _name(offload, child_names.BUILD),
        "build",
        ingress=[],
        egress=[rules.names(), rules.anybody(*ports)],
    )


def _to_servers(offload: RobotOffload) -> list[Manifest]:
    if not transport.discovery_servers(offload.spec):
        return []
    return [rules.going_to(selector(offload, "discovery"), rules.port(discovery.PORT.protocol, discovery.PORT.number))]
