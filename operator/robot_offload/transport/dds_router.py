"""DDSRouter: a DDS Router on each side, joined by one TCP connection over TLS that the robot opens.

The cloud's router announces the address on which it is reached, so there are two phases: first the Service, and once
it has an address the router's configuration and pod. The router proves to the robot who it is; it cannot ask the
robot for a certificate, so keep strangers away by the load balancer's source ranges or a VPN.
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
from robot_offload.transport import carried, discovery
from robot_offload.transport import dds_router_config as router
from robot_offload.transport.base import Transport
from robot_offload.transport.exposure import Exposed, addresses, service
from robot_offload.transport.port import ContainerPort, Traits

PORT: Final = ContainerPort("router", "TCP", 11666)

CONFIG_DIR: Final = "/etc/robot-offload/router"
CONFIG_KEY: Final = "router.yaml"
ROBOT_FILE: Final = "ddsrouter.yaml"
_DH_KEY: Final = "ffdhe2048.pem"
_DH_PARAMETERS: Final = """\
-----BEGIN DH PARAMETERS-----
MIIBCAKCAQEA//////////+t+FRYortKmq/cViAnPTzx2LnFg84tNpWp4TZBFGQz
+8yTnc4kmz75fS/jY2MMddj2gbICrsRhetPfHtXV/WVhJDP1H18GbtCFY2VVPe0a
87VXE15/V8k1mE8McODmi3fipona8+/och3xWKE2rec1MKzKT0g6eXq8CrGCsyT7
YdEIqUuyyOP7uWrat2DX9GgdT0Kj3jlN9K5W7edjcrsZCwenyO4KbXCeAvzhzffi
7MA0BM0oNC9hkXL+nOmFg/+OTxIy7vKBg8P+OxtMb61zO7X8vC7CIAXFjvGDfRaD
ssbzSibBsu/6iGtCOGEoXJf//////////wIBAg==
-----END DH PARAMETERS-----
"""
"""The group ffdhe2048 of RFC 7919: public and the same for everybody; without such a file there is no TLS server."""


def cloud_config(offload: RobotOffload, discovery_hosts: Sequence[str], announced: Endpoint) -> dict[str, Any]:
    """Returns the configuration of the router in the cloud."""
    servers = [router.address(host, discovery.PORT.number, "udp") for host in discovery_hosts]
    cluster = {
        "name": router.CLUSTER,
        "kind": "local-discovery-server",
        "domain": offload.spec.cloud_domain_id,
        "connection-addresses": servers,
    }
    tls = {
        "private_key": f"{pod.CERTIFICATES_DIR}/tls.key",
        "cert": f"{pod.CERTIFICATES_DIR}/tls.crt",
        "dh_params": f"{CONFIG_DIR}/{_DH_KEY}",
    }
    listening = router.address(announced.host, PORT.number, "tcp", announced.port)
    wan = {"name": router.WAN, "kind": "wan", "listening-addresses": [listening], "tls": tls}
    return router.config([cluster, wan], carried.topics(offload.spec))


def robot_config(offload: RobotOffload, announced: Endpoint, folder: str) -> dict[str, Any]:
    """Returns the configuration of the router on the robot; `folder` is where the bundle lies."""
    spec = offload.spec
    block = spec.transport.dds_router
    domain = spec.robot.domain_id if block.domain_id is None else block.domain_id
    tls = {"ca": f"{folder}/certificates/ca.pem"}
    if spec.transport.expose.host:
        tls["sni_host"] = spec.transport.expose.host
    connecting = router.address(announced.host, announced.port, "tcp")
    wan = {"name": router.WAN, "kind": "wan", "connection-addresses": [connecting], "tls": tls}
    return router.config([{"name": router.ROBOT, "kind": "local", "domain": domain}, wan], carried.topics(spec))


def _name(offload: RobotOffload) -> str:
    return child_name(offload.metadata.name, ROUTER)


def _part(parent: Parent) -> Part:
    return Part(_name(parent.offload), "router")


def _deployment(parent: Parent, read: str) -> Manifest:
    container = pod.container(
        "router",
        parent.facts.images.router,
        ["ddsrouter", "-c", f"{CONFIG_DIR}/{CONFIG_KEY}"],
        # Nothing of ROS: the router unsets some of these variables itself and stumbles over others.
        environment={"HOME": pod.TMP, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
        mounts=[pod.mount("configuration", CONFIG_DIR), pod.mount("certificates", pod.CERTIFICATES_DIR)],
        resources={"requests": {"cpu": "50m", "memory": "64Mi"}, "limits": {"memory": "512Mi"}},
        extra={
            "ports": [{"name": PORT.name, "containerPort": PORT.number, "protocol": PORT.protocol}],
            "readinessProbe": {"tcpSocket": {"port": PORT.name}, "periodSeconds": 5, "timeoutSeconds": 2},
        },
    )
    volumes = [
        pod.config_map_volume("configuration", _name(parent.offload), [CONFIG_KEY, _DH_KEY]),
        pod.certificates_volume(child_name(parent.name, CLOUD)),
    ]
    template = pod.pod_template(
        parent,
        _part(parent),
        [container],
        read=read,
        grace_s=5,
        volumes=volumes,
    )
    return pod.deployment(parent, _part(parent), template)


def _text(document: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(document), sort_keys=False, width=1000)


class DDSRouter(Transport):
    """Joins the sides by a DDS Router on each."""

    traits: ClassVar[Traits] = Traits()

    def purposes(self, offload: RobotOffload) -> tuple[Purpose, ...]:
        """Returns the cloud's router."""
        return ("router",)

    def services(self, parent: Parent) -> tuple[Manifest, ...]:
        """Returns the router's Service, and those of the discovery servers for the nodes."""
        transport = parent.spec.transport
        node_port = transport.expose.node_ports.router if transport.expose.node_ports else None
        exposed = [Exposed(PORT, transport.dds_router.port, node_port)]
        return (*super().services(parent), service(parent, _part(parent), exposed))

    def workloads(self, parent: Parent) -> tuple[Manifest, ...]:
        """Returns the discovery servers, and the router as soon as its own address and theirs are known."""
        servers = super().workloads(parent)
        announced = parent.facts.endpoints_for("router")
        if not announced or not parent.facts.discovery_hosts:
            return servers
        data = {
            CONFIG_KEY: _text(cloud_config(parent.offload, parent.facts.discovery_hosts, announced[0])),
            _DH_KEY: _DH_PARAMETERS,
        }
        return (
            *servers,
            parent.config_map(_part(parent), data),
            _deployment(parent, config_hash(data, parent.facts.certificate_hash)),
        )

    def policies(self, parent: Parent) -> tuple[Manifest, ...]:
        """Returns the router's: the robot may come, and it may talk to nodes and discovery servers."""
        incoming, outgoing = rules.dds_both_ways(parent.offload, robot=False)
        servers = rules.going_to(
            selector(parent.offload, "discovery"), rules.port(discovery.PORT.protocol, discovery.PORT.number)
        )
        return (
            rules.policy(
                parent,
                _part(parent),
                ingress=[rules.anybody(rules.port(PORT.protocol, PORT.number)), *incoming],
                egress=[rules.names(), *outgoing, servers],
            ),
        )

    def robot_files(self, offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str) -> Mapping[str, bytes]:
        """Returns the configuration of the router on the robot."""
        announced = next(one for one in endpoints if one.purpose == "router")
        return {ROBOT_FILE: _text(robot_config(offload, announced, folder)).encode()}

    def observed_endpoints(
        self, offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
    ) -> tuple[Endpoint, ...]:
        """Returns the one address that the router announces."""
        found = addresses(offload, services, nodes, _name(offload), PORT.name)
        return tuple(Endpoint("router", "TCP", host, port) for host, port in found[:1])
