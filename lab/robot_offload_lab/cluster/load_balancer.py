"""Which addresses Services of type LoadBalancer get, and through which node each is reached."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from robot_offload_lab.cluster.layout import Layout

Object = Mapping[str, Any]
FIRST, LAST = 10, 250
_NOT_BY = "node.kubernetes.io/exclude-from-external-load-balancers"
"""Label of nodes that take no traffic from outside, such as those of a control plane."""


def ingress(service: Object) -> str | None:
    """Return the address that a Service has already."""
    given = service.get("status", {}).get("loadBalancer", {}).get("ingress") or [{}]
    address = given[0].get("ip")
    return None if address is None else str(address)


def is_balanced(service: Object) -> bool:
    """Return whether a Service asks for an address of ours."""
    wanted: bool = service["spec"].get("type") == "LoadBalancer" and "deletionTimestamp" not in service["metadata"]
    return wanted and not service["spec"].get("loadBalancerClass")


def missing_addresses(services: Iterable[Object], layout: Layout) -> list[tuple[Object, str]]:
    """Return the Services without an address, each with the address that it gets."""
    balanced = sorted(filter(is_balanced, services), key=lambda each: str(each["metadata"]["creationTimestamp"]))
    taken = {ingress(each) for each in balanced}
    found = []
    for service in balanced:
        if ingress(service) is not None:
            continue
        wish = service["spec"].get("loadBalancerIP")
        free = (layout.balancer(each) for each in range(FIRST, LAST) if layout.balancer(each) not in taken)
        address = wish or next(free, None)
        if address is not None:
            taken.add(address)
            found.append((service, address))
    return found


def routes(
    services: Iterable[Object],
    slices: Iterable[Object],
    nodes: Iterable[Object],
    present: Mapping[str, str],
    layout: Layout,
) -> dict[str, str]:
    """Return load balancer address -> address of the node that takes its traffic; without one it is unreachable.

    A route that still works is kept, so that no connection breaks needlessly.

    Args:
        services: Services of the cluster.
        slices: Its EndpointSlices.
        nodes: Its nodes.
        present: The previous result.
        layout: Layout of the cluster.
    """
    takers = (node for node in nodes if is_ready(node) and _NOT_BY not in node["metadata"].get("labels", {}))
    alive = {str(node["metadata"]["name"]): _address(node) for node in takers}
    slices = list(slices)
    found = {}
    for service in services:
        address = ingress(service)
        if address is None or not is_balanced(service):
            continue
        able = _able(service, slices, sorted(alive))
        addresses = [alive[name] for name in able]
        if addresses:
            now = present.get(address, "")
            found[address] = now if now in addresses else addresses[0]
    return found


def is_ready(node: Object) -> bool:
    """Return whether a node works."""
    conditions = node.get("status", {}).get("conditions", [])
    return any(each["type"] == "Ready" and each["status"] == "True" for each in conditions)


def _able(service: Object, slices: Sequence[Object], alive: Sequence[str]) -> list[str]:
    """Return the nodes that may take a Service's traffic: all, or with `Local` those that have a pod of it."""
    if service["spec"].get("externalTrafficPolicy") != "Local":
        return list(alive)
    metadata = service["metadata"]
    with_pod = {
        endpoint.get("nodeName")
        for each in slices
        if each["metadata"]["namespace"] == metadata["namespace"]
        and each["metadata"].get("labels", {}).get("kubernetes.io/service-name") == metadata["name"]
        for endpoint in each.get("endpoints") or []
        if endpoint.get("conditions", {}).get("ready", True)
    }
    return [name for name in alive if name in with_pod]


def _address(node: Object) -> str:
    return next(str(each["address"]) for each in node["status"]["addresses"] if each["type"] == "InternalIP")
