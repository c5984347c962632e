"""RobotOffload + facts -> all objects in the cluster but the Secrets, in the order in which they are applied."""

from __future__ import annotations

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Facts, Manifest
from robot_offload.render import dds_profile
from robot_offload.render.agent_workload import agent_deployment, agent_objects
from robot_offload.render.network_policies import network_policies
from robot_offload.render.node_workloads import node_deployments, parameter_copies

__all__ = ["Manifest", "children"]


def children(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The children. Rules and addresses come before what uses them; pods come last.

    The DDS Router's configuration and pod are missing until `facts.endpoints` says where it is reached, and everything
    that finds others through discovery servers until `facts.discovery_hosts` says where those are.

    Args:
        offload: as it was accepted; a specification with findings of severity error is never rendered.
        facts: the state of the cluster as far as the children depend on it.
    """
    chosen = transport.of(offload.spec)
    findable = bool(facts.discovery_hosts) or not transport.discovery_servers(offload.spec)
    participants = (agent_deployment(offload, facts), *node_deployments(offload, facts)) if findable else ()
    return (
        *network_policies(offload, facts),
        *chosen.services(offload, facts),
        *agent_objects(offload, facts),
        *parameter_copies(offload, facts),
        *dds_profile.config_maps(offload, facts),
        *chosen.workloads(offload, facts),
        *participants,
    )
