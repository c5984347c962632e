"""Fast DDS discovery servers in the cluster: clusters carry no multicast, so nodes find each other through these.

One StatefulSet and one Service per server id, never replicas behind one Service: two servers must not share an
identity, and a participant knows them by their place in the list.

Participants get the addresses of the Services, not their names: Fast DDS resolves a name once, when a participant
starts, and drops the whole list if one name is unknown at that moment. A name server that was asked just before a
Service was created denies it for some seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.kinds import SERVICE, STATEFUL_SET
from robot_offload.kube.port import Manifest
from robot_offload.objects import pod
from robot_offload.objects.facts import Facts, address
from robot_offload.objects.hashes import config_hash
from robot_offload.objects.labels import selector
from robot_offload.objects.names import discovery_child
from robot_offload.objects.parent import Parent, Part
from robot_offload.transport.port import ContainerPort

PORT: Final = ContainerPort("discovery", "UDP", 11811)
FOUND_AT_ONCE: Final = {"publishNotReadyAddresses": True}
"""Of a server's Service. While a Service has no endpoint, connection tracking may record participants' repeated packets
as undeliverable, and they would then not reach the server when it returns."""
GONE_S: Final = 6
"""How long an ending server stays away (images/discovery/start): longer than participants keep it alive."""
SETTLED_S: Final = 5
"""Seconds in which participants find a returned server again (they ask each 0.45 s) and send it everything."""
SERVER_LABEL: Final = "robotoffload.dev/discovery-server"


def names(offload: RobotOffload) -> tuple[str, ...]:
    """Return the names of the servers' objects, by their ids."""
    servers = range(offload.spec.cloud.discovery_servers)
    return tuple(discovery_child(offload.metadata.name, server) for server in servers)


def hosts(offload: RobotOffload, services: Iterable[Manifest]) -> tuple[str, ...]:
    """Return the addresses of the servers' Services in the cluster, by the servers' ids; empty: some are not known yet.

    Args:
        offload: owner of the servers.
        services: its own, as they are in the cluster.
    """
    by_name = {one["metadata"]["name"]: (one.get("spec") or {}).get("clusterIP") or "" for one in services}
    found = tuple(by_name.get(name, "") for name in names(offload))
    return found if all(host not in ("", "None") for host in found) else ()


def environment(facts: Facts) -> dict[str, str]:
    """Return the environment of a participant that uses the servers for discovery."""
    return {"ROS_DISCOVERY_SERVER": ";".join(address(host, PORT.number) for host in facts.discovery_hosts)}


def part(server: int, name: str) -> Part:
    """Return the part of a server: each has its own pod."""
    return Part(name, "discovery", {SERVER_LABEL: str(server)})


def services(parent: Parent) -> tuple[Manifest, ...]:
    """Return the Services for use inside the cluster, for transports that do not expose the servers."""
    return tuple(_service(parent, part(server, name)) for server, name in enumerate(names(parent.offload)))


def stateful_sets(parent: Parent) -> tuple[Manifest, ...]:
    """Return the servers. They are never scaled to zero."""
    return tuple(_stateful_set(parent, server, name) for server, name in enumerate(names(parent.offload)))


def _service(parent: Parent, own: Part) -> Manifest:
    port = {"name": PORT.name, "port": PORT.number, "targetPort": PORT.name, "protocol": PORT.protocol}
    spec = {"type": "ClusterIP", **FOUND_AT_ONCE, "selector": parent.selector(own), "ports": [port]}
    return parent.child(SERVICE, own, {"spec": spec})


def _stateful_set(parent: Parent, server: int, name: str) -> Manifest:
    own = part(server, name)
    container = pod.container(
        "discovery",
        parent.facts.images.discovery,
        ["fast-discovery-server", "-i", str(server), "-l", "0.0.0.0", "-p", str(PORT.number)],  # noqa: S104 - in a pod
        environment={"HOME": pod.TMP},
        resources={"requests": {"cpu": "20m", "memory": "32Mi"}, "limits": {"memory": "256Mi"}},
        extra={
            "ports": [{"name": PORT.name, "containerPort": PORT.number, "protocol": PORT.protocol}],
            # It answers only DDS; from outside, only its open port can be seen.
            "readinessProbe": pod.listens(PORT.number, "udp"),
        },
    )
    template = pod.pod_template(
        parent,
        own,
        [container],
        read=config_hash("discovery"),
        grace_s=GONE_S + 6,
        extra={"affinity": _apart(parent.offload)},
    )
    spec = {
        "replicas": 1,
        "minReadySeconds": SETTLED_S,
        "serviceName": name,
        "revisionHistoryLimit": 2,
        "selector": {"matchLabels": parent.selector(own)},
        "template": template,
    }
    return parent.child(STATEFUL_SET, own, {"spec": spec})


def _apart(offload: RobotOffload) -> Manifest:
    """Return a preference for different nodes for one robot's servers, so that they do not fail together."""
    term = {
        "topologyKey": "kubernetes.io/hostname",
        "labelSelector": {"matchLabels": selector(offload, "discovery")},
    }
    preferred = [{"weight": 100, "podAffinityTerm": term}]
    return {"podAntiAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": preferred}}
