"""Building blocks of network policies: our pods' declared traffic. Everything else is refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.kinds import NETWORK_POLICY
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Network
from robot_offload.objects.labels import instance_labels
from robot_offload.objects.parent import Parent, Part

_DDS_BASE: Final = 7400
_PORTS_PER_DOMAIN: Final = 250
_NAMESPACE: Final = "kubernetes.io/metadata.name"
_LAST_PORT: Final = 65535
_EVERYWHERE: Final = {"0.0.0.0/0": ("169.254.0.0/16",), "::/0": ("fe80::/10", "fd00:ec2::254/128")}
"""All addresses, each without the link-local ones (RFC 3927, RFC 4291) and AWS's metadata service over IPv6."""
_KUBERNETES_API: Final = (443, 6443, 8443, 16443)
"""The Service's port, and the usual ports of API servers: most networks see the port behind the Service."""


def policy(
    parent: Parent,
    part: Part,
    *,
    ingress: Sequence[Manifest],
    egress: Sequence[Manifest],
) -> Manifest:
    """Return the policy of the pods of one part: closed both ways except for these rules."""
    spec: Manifest = {
        "podSelector": {"matchLabels": parent.selector(part)},
        "policyTypes": ["Ingress", "Egress"],
    }
    # The API server drops empty lists, so the object would always seem changed.
    spec |= {way: list(given) for way, given in (("ingress", ingress), ("egress", egress)) if given}
    return parent.child(NETWORK_POLICY, Part(part.name, "network"), {"spec": spec})


def port(protocol: str, number: int, end: int | None = None) -> Manifest:
    """Return one port, or all from `number` to `end`."""
    result: Manifest = {"protocol": protocol, "port": number}
    return result if end is None else {**result, "endPort": end}


def anybody(*ports: Manifest) -> Manifest:
    """Return a rule, for either direction, for these ports and any other end."""
    return {"ports": list(ports)}


def outside(*ports: Manifest) -> Manifest:
    """Return a rule for traffic to any host or pod except the machines' own services, such as a cloud's metadata."""
    blocks = [{"cidr": cidr, "except": list(kept)} for cidr, kept in _EVERYWHERE.items()]
    return {"to": [{"namespaceSelector": {}}, *({"ipBlock": block} for block in blocks)], "ports": list(ports)}


def coming_from(labels: dict[str, str], *ports: Manifest) -> Manifest:
    """Return a rule for traffic from pods of this namespace with these labels."""
    return {"from": [{"podSelector": {"matchLabels": labels}}], "ports": list(ports)}


def going_to(labels: dict[str, str], *ports: Manifest) -> Manifest:
    """Return a rule for traffic to pods of this namespace with these labels."""
    return {"to": [{"podSelector": {"matchLabels": labels}}], "ports": list(ports)}


def dds(offload: RobotOffload) -> Manifest:
    """Return the UDP ports of DDS participants in the cloud's domain."""
    first = _DDS_BASE + _PORTS_PER_DOMAIN * offload.spec.cloud_domain_id
    return port("UDP", first, min(first + _PORTS_PER_DOMAIN - 1, _LAST_PORT))


def dds_both_ways(offload: RobotOffload, *, robot: bool) -> tuple[list[Manifest], list[Manifest]]:
    """Return rules for DDS between the pods of this RobotOffload, both ways; with the robot anywhere, if `robot`."""
    ports = dds(offload)
    if robot:
        return [anybody(ports)], [anybody(ports)]
    pods = instance_labels(offload)
    return [coming_from(pods, ports)], [going_to(pods, ports)]


def names(network: Network) -> Manifest:
    """Return the rule for DNS, whose server may be anywhere, even on the node, unless its networks are given."""
    return _within(network.dns, port("UDP", 53), port("TCP", 53))


def kubernetes_api(network: Network) -> Manifest:
    """Return the rule for the API server, whose address no label identifies."""
    return _within(network.api_server, *(port("TCP", number) for number in _KUBERNETES_API))


def reporting(network: Network, *ports: Manifest) -> list[Manifest]:
    """Return rules for readers of a reporter: Prometheus, and people through the API server's proxy."""
    peers: list[Manifest] = [
        {"namespaceSelector": {"matchLabels": {_NAMESPACE: name}}} for name in network.metrics_from
    ]
    peers += [{"ipBlock": {"cidr": source}} for source in network.api_server_from]
    return [{"from": peers, "ports": list(ports)}] if peers else []


def _within(networks: Sequence[str], *ports: Manifest) -> Manifest:
    if not networks:
        return anybody(*ports)
    return {"to": [{"ipBlock": {"cidr": network}} for network in networks], "ports": list(ports)}
