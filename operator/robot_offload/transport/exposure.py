"""Services through which the robot reaches the cloud, and the addresses that the cluster assigns to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.kinds import SERVICE
from robot_offload.kube.port import Manifest
from robot_offload.objects.parent import Parent, Part
from robot_offload.transport.port import ContainerPort

MAX_NODE_ADDRESSES: Final = 3
"""Maximum of cluster node addresses for a robot with a NodePort: enough that one may fail."""


@dataclass(frozen=True, slots=True)
class Exposed:
    """One port of a Service.

    Attributes:
        target: its container port.
        port: on the Service.
        node_port: on every node of the cluster; None: the cluster chooses.
    """

    target: ContainerPort
    port: int
    node_port: int | None = None


def service(
    parent: Parent,
    part: Part,
    ports: Sequence[Exposed],
    extra: Manifest | None = None,
) -> Manifest:
    """Return a Service of the declared type. One protocol each: many load balancers refuse a mix."""
    expose = parent.spec.transport.expose
    spec: Manifest = {
        "type": expose.type,
        **(extra or {}),
        "selector": parent.selector(part),
        "ports": [_port(one, with_node_port=expose.type != "ClusterIP") for one in ports],
    }
    if expose.type == "LoadBalancer":
        if not parent.facts.load_balancer_node_ports and expose.node_ports is None:
            spec["allocateLoadBalancerNodePorts"] = False
        if expose.address is not None:
            spec["loadBalancerIP"] = expose.address
        if expose.load_balancer_class is not None:
            spec["loadBalancerClass"] = expose.load_balancer_class
        if expose.source_ranges:
            spec["loadBalancerSourceRanges"] = list(expose.source_ranges)
    return parent.child(SERVICE, part, {"spec": spec}, expose.annotations)


def _port(exposed: Exposed, *, with_node_port: bool) -> Manifest:
    result: Manifest = {
        "name": exposed.target.name,
        "port": exposed.port,
        "targetPort": exposed.target.name,
        "protocol": exposed.target.protocol,
    }
    if with_node_port and exposed.node_port is not None:
        result["nodePort"] = exposed.node_port
    return result


def addresses(
    offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest], name: str, port: str
) -> tuple[tuple[str, int], ...]:
    """Return hosts and ports at which one port of a Service is reached from outside; empty: not known yet.

    Args:
        offload: with the type and the declared host.
        services: as they are in the cluster.
        nodes: the cluster's nodes.
        name: of the Service.
        port: its name in the Service.
    """
    expose = offload.spec.transport.expose
    live = next((one for one in services if one["metadata"]["name"] == name), None)
    found = next((one for one in _spec(live).get("ports") or () if one.get("name") == port), None)
    if live is None or found is None or _spec(live).get("type", "ClusterIP") != expose.type:
        return ()
    if expose.type == "NodePort":
        number = found.get("nodePort")
        hosts = [expose.host] if expose.host else list(_node_hosts(nodes))[:MAX_NODE_ADDRESSES]
        return tuple((host, int(number)) for host in hosts) if number else ()
    host = expose.host or _service_host(live)
    # A declared name may lead anywhere, but nothing answers there until the load balancer has an address.
    known = host and (expose.type == "ClusterIP" or _ingress(live))
    return ((host, int(found["port"])),) if host and known else ()


def _spec(service: Manifest | None) -> dict[str, Any]:
    return (service or {}).get("spec") or {}


def _service_host(service: Manifest) -> str | None:
    if _spec(service).get("type") == "LoadBalancer":
        return _ingress(service)
    address = _spec(service).get("clusterIP")
    return address if address and address != "None" else None


def _ingress(service: Manifest) -> str | None:
    entries = ((service.get("status") or {}).get("loadBalancer") or {}).get("ingress") or ()
    found = [str(host) for entry in entries if (host := entry.get("ip") or entry.get("hostname"))]
    return min(found, key=is_ipv6, default=None)


def is_ipv6(host: str) -> bool:
    """Return whether a host is an IPv6 address: the cloud's programs listen only on IPv4."""
    return ":" in host


def _node_hosts(nodes: Sequence[Manifest]) -> Iterator[str]:
    """Yield one address of each ready node, the external one if it has one, in the order of the nodes' names."""
    for node in sorted(nodes, key=lambda one: str(one["metadata"]["name"])):
        status = node.get("status") or {}
        ready = any(c.get("type") == "Ready" and c.get("status") == "True" for c in status.get("conditions") or ())
        known = sorted(status.get("addresses") or (), key=lambda one: is_ipv6(str(one.get("address"))))
        by_type = {one.get("type"): one.get("address") for one in reversed(known)}
        address = by_type.get("ExternalIP") or by_type.get("InternalIP")
        if ready and address:
            yield str(address)
