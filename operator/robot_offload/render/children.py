"""RobotOffload + facts -> all objects in the cluster except the Secrets, in the order in which they are applied."""

from __future__ import annotations

from robot_offload import transport
from robot_offload.kube.port import Manifest
from robot_offload.objects.parent import Parent
from robot_offload.render import dds_profile
from robot_offload.render.agent_workload import agent_deployment, agent_objects
from robot_offload.render.network_policies import network_policies
from robot_offload.render.node_workloads import node_deployments, parameter_copies


def children(parent: Parent) -> tuple[Manifest, ...]:
    """Return the children. Rules and addresses come before their users; pods come last.

    The DDS Router's configuration and pod are missing until `facts.endpoints` has its address, and everything that uses
    discovery servers until `facts.discovery_hosts` has theirs.

    Args:
        parent: a specification with findings of severity error is never rendered.
    """
    chosen = transport.of(parent.spec)
    findable = bool(parent.facts.discovery_hosts) or not transport.discovery_servers(parent.spec)
    participants = (agent_deployment(parent), *node_deployments(parent)) if findable else ()
    return (
        *network_policies(parent),
        *chosen.services(parent),
        *agent_objects(parent),
        *parameter_copies(parent),
        *dds_profile.config_maps(parent),
        *chosen.workloads(parent),
        *participants,
    )
