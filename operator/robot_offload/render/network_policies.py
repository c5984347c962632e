"""The network policies of a RobotOffload: default deny both ways for our pods, then the declared traffic."""

from __future__ import annotations

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects import names
from robot_offload.objects import policy_rules as rules
from robot_offload.objects.labels import instance_labels, selector
from robot_offload.objects.names import child_name
from robot_offload.objects.parent import Parent, Part
from robot_offload.render import handover
from robot_offload.render.build_job import build_ports
from robot_offload.transport import discovery


def network_policies(parent: Parent) -> tuple[Manifest, ...]:
    """Return one policy per component that has pods; none if the cluster's administrator disabled them."""
    if not parent.facts.network.policies:
        return ()
    found = [_agent(parent), _nodes(parent)]
    if transport.discovery_servers(parent.spec):
        found.append(_discovery(parent))
    if parent.spec.built_nodes:
        found.append(_builds(parent))
    return (*found, *transport.of(parent.spec).policies(parent))


def _agent(parent: Parent) -> Manifest:
    chosen = transport.of(parent.spec)
    incoming, outgoing = rules.dds_both_ways(parent.offload, robot=chosen.traits.robot_speaks_dds)
    handing_over = rules.coming_from(selector(parent.offload, "node"), rules.port("TCP", handover.PORT))
    ports = [rules.port(one.protocol, one.number) for one in transport.agent_ports(parent.offload)]
    reading = rules.reporting(parent.facts.network, rules.port("TCP", handover.PORT))
    # The robot comes through NAT from anywhere; its certificate proves its identity.
    robot = [rules.anybody(*ports)] if ports else []
    return rules.policy(
        parent,
        Part(child_name(parent.name, names.AGENT), "agent"),
        ingress=[*robot, handing_over, *reading, *incoming],
        egress=[
            rules.names(parent.facts.network),
            *outgoing,
            *_to_servers(parent.offload),
            rules.kubernetes_api(parent.facts.network),
        ],
    )


def _nodes(parent: Parent) -> Manifest:
    incoming, outgoing = rules.dds_both_ways(parent.offload, robot=transport.of(parent.spec).traits.robot_speaks_dds)
    handing_over = rules.going_to(selector(parent.offload, "agent"), rules.port("TCP", handover.PORT))
    return rules.policy(
        parent,
        Part(child_name(parent.name, names.NODES), "node"),
        ingress=incoming,
        egress=[rules.names(parent.facts.network), *outgoing, *_to_servers(parent.offload), handing_over],
    )


def _discovery(parent: Parent) -> Manifest:
    robot = transport.of(parent.spec).traits.robot_speaks_dds
    # A server answers to a participant's announced ports, not to the port from which it asked.
    incoming, outgoing = rules.dds_both_ways(parent.offload, robot=robot)
    port = rules.port(discovery.PORT.protocol, discovery.PORT.number)
    asking = rules.anybody(port) if robot else rules.coming_from(instance_labels(parent.offload), port)
    return rules.policy(
        parent,
        Part(child_name(parent.name, names.DISCOVERY), "discovery"),
        ingress=[asking, *incoming],
        egress=[rules.names(parent.facts.network), *outgoing],
    )


def _builds(parent: Parent) -> Manifest:
    # Sources, packages and base images come from hosts without labels; the ports are known.
    ports = [rules.port("TCP", number) for number in build_ports(parent.spec)]
    return rules.policy(
        parent,
        Part(child_name(parent.name, names.BUILD), "build"),
        ingress=[],
        egress=[rules.names(parent.facts.network), rules.outside(*ports)],
    )


def _to_servers(offload: RobotOffload) -> list[Manifest]:
    if not transport.discovery_servers(offload.spec):
        return []
    return [rules.going_to(selector(offload, "discovery"), rules.port(discovery.PORT.protocol, discovery.PORT.number))]
