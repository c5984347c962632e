"""DDSRouter: a DDS Router on each side, joined by a tunnel that the robot opens.

The routers talk plain TCP over the loopback interface to the tunnel beside them. The tunnel is one TCP connection with
mutual TLS. The routers' files contain no address of the cloud.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

import yaml

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects import pod
from robot_offload.objects import policy_rules as rules
from robot_offload.objects.facts import Endpoint, Purpose
from robot_offload.objects.hashes import config_hash
from robot_offload.objects.labels import selector
from robot_offload.objects.names import CLOUD, ROUTER, child_name
from robot_offload.objects.parent import Parent, Part
from robot_offload.transport import carried, dds_router_xml, discovery, tunnel
from robot_offload.transport import dds_router_config as router
from robot_offload.transport.base import Transport
from robot_offload.transport.exposure import Exposed, addresses, service
from robot_offload.transport.port import Traits

CONFIG_DIR: Final = "/etc/robot-offload/router"
CONFIG_KEY: Final = "router.yaml"
ROBOT_FILE: Final = "ddsrouter.yaml"


def cloud_config(offload: RobotOffload, discovery_hosts: Sequence[str]) -> dict[str, Any]:
    """Return the configuration of the router in the cloud."""
    servers = [router.address(host, discovery.PORT.number, "udp") for host in discovery_hosts]
    cluster = {
        "name": router.CLUSTER,
        "kind": "local-discovery-server",
        "domain": offload.spec.cloud_domain_id,
        "connection-addresses": servers,
    }
    return configuration(offload, cluster, dds_router_xml.profile(listening=dds_router_xml.LISTENING))


def robot_config(offload: RobotOffload) -> dict[str, Any]:
    """Return the configuration of the router on the robot."""
    block = offload.spec.transport.dds_router
    domain = offload.spec.robot.domain_id if block.domain_id is None else block.domain_id
    # Without shared memory: the router may be in a container, or use another version of Fast DDS than the nodes.
    local = {"name": router.ROBOT, "kind": "local", "domain": domain, "transport": "udp"}
    return configuration(offload, local, dds_router_xml.profile())


def configuration(offload: RobotOffload, local: Mapping[str, Any], xml: str) -> dict[str, Any]:
    """Return the configuration of a router.

    Args:
        offload: declares what crosses.
        local: the participant for the nodes of this side; its name identifies this side.
        xml: the profile of the participant for the other side.
    """
    spec = offload.spec
    return router.config(local, dds_router_xml.PROFILE, xml, carried.to_cloud(spec), carried.to_robot(spec))


def _name(offload: RobotOffload) -> str:
    return child_name(offload.metadata.name, ROUTER)


def _part(parent: Parent) -> Part:
    return Part(_name(parent.offload), "router")


def _deployment(parent: Parent, read: str) -> Manifest:
    mounts = [pod.mount("configuration", CONFIG_DIR)]
    container = pod.container(
        "router",
        parent.facts.images.router,
        ["ddsrouter", "-c", f"{CONFIG_DIR}/{CONFIG_KEY}"],
        # Without ROS variables: the router unsets some of them itself and stumbles over others.
        environment={"HOME": pod.TMP, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
        mounts=mounts,
        resources={"requests": {"cpu": "50m", "memory": "64Mi"}, "limits": {"memory": "512Mi"}},
        extra={"readinessProbe": pod.listens(dds_router_xml.LISTENING)},
    )
    certificates = pod.mount("certificates", pod.CERTIFICATES_DIR)
    template = pod.pod_template(
        parent,
        _part(parent),
        [container, tunnel.container(parent.facts, CONFIG_DIR, [*mounts, certificates])],
        read=read,
        grace_s=5,
        volumes=[
            pod.config_map_volume("configuration", _name(parent.offload), [CONFIG_KEY, tunnel.FILE]),
            pod.certificates_volume(child_name(parent.name, CLOUD)),
        ],
    )
    return pod.deployment(parent, _part(parent), template)


class _Dumper(yaml.SafeDumper):
    """Writes multi-line texts as blocks."""


def _block(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Dumper.add_representer(str, _block)


def text(document: Mapping[str, Any]) -> str:
    """Return a document as YAML."""
    return yaml.dump(dict(document), Dumper=_Dumper, sort_keys=False, width=1000)


class DDSRouter(Transport):
    """Connects the sides with a DDS Router on each."""

    traits: ClassVar[Traits] = Traits()

    def purposes(self, offload: RobotOffload) -> tuple[Purpose, ...]:
        """Return the tunnel to the cloud's router."""
        return ("router",)

    def services(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the Service of the tunnel to the router, and those of the discovery servers for the nodes."""
        transport = parent.spec.transport
        node_port = transport.expose.node_ports.router if transport.expose.node_ports else None
        exposed = [Exposed(tunnel.PORT, transport.dds_router.port, node_port)]
        return (*super().services(parent), service(parent, _part(parent), exposed))

    def workloads(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the discovery servers, and the router once their addresses are known."""
        servers = super().workloads(parent)
        if not parent.facts.discovery_hosts:
            return servers
        data = {
            CONFIG_KEY: text(cloud_config(parent.offload, parent.facts.discovery_hosts)),
            tunnel.FILE: text(tunnel.in_the_cloud(parent.certificate_name("robot"))),
        }
        return (
            *servers,
            parent.config_map(_part(parent), data),
            _deployment(parent, config_hash(data, parent.facts.certificate_hash)),
        )

    def policies(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the router's policy: open to the robot, and from it to nodes and discovery servers."""
        incoming, outgoing = rules.dds_both_ways(parent.offload, robot=False)
        servers = rules.going_to(
            selector(parent.offload, "discovery"), rules.port(discovery.PORT.protocol, discovery.PORT.number)
        )
        return (
            rules.policy(
                parent,
                _part(parent),
                ingress=[rules.anybody(rules.port(tunnel.PORT.protocol, tunnel.PORT.number)), *incoming],
                egress=[rules.names(parent.facts.network), *outgoing, servers],
            ),
        )

    def robot_files(
        self, offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str, state_dir: str
    ) -> Mapping[str, bytes]:
        """Return the configurations of the router and of the tunnel on the robot."""
        addresses = [one for one in endpoints if one.purpose == "router"]
        # Without a declared name the address may change; an authority for this robot alone is enough.
        named = offload.spec.transport.expose.host is not None
        dialled = tunnel.on_the_robot(addresses, f"{folder}/certificates", state_dir, verify_name=named)
        return {ROBOT_FILE: text(robot_config(offload)).encode(), tunnel.FILE: text(dialled).encode()}

    def observed_endpoints(
        self, offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
    ) -> tuple[Endpoint, ...]:
        """Return the addresses of the tunnel; with node ports several, which the robot tries in turn."""
        found = addresses(offload, services, nodes, _name(offload), tunnel.PORT.name)
        return tuple(Endpoint("router", "TCP", host, port) for host, port in found)
