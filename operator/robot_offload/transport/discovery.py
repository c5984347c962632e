"""Fast DDS discovery servers in the cluster: clusters carry no multicast, so nodes find each other through these.

One StatefulSet and one Service per server id, never replicas behind one Service: two servers must not share an
identity, and a participant knows them by their place in the list.

Participants are given the addresses of the Services, not their names: Fast DDS resolves a name once, when a participant
starts, and forgets the whole list when one name is not known at that moment. A name server that was asked just before a
Service came says for some seconds that there is none.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects import pod
from robot_offload.objects.child import child
from robot_offload.objects.child_names import discovery_child
from robot_offload.objects.facts import Facts, Manifest, address
from robot_offload.objects.hashes import config_hash
from robot_offload.objects.labels import selector
from robot_offload.transport.port import ContainerPort

PORT: Final = ContainerPort("discovery", "UDP", 11811)
FOUND_AT_ONCE: Final = {"publishNotReadyAddresses": True}
"""Of a server's Service. While a Service leads nowhere, what participants keep sending to it may be remembered on its
way (connection tracking) as leading nowhere, and they do not reach the server when it comes back."""
SERVER_LABEL: Final = "robotoffload.dev/discovery-server"


def names(offload: RobotOffload) -> tuple[str, ...]:
    """The names of the servers' objects, by their ids."""
    servers = range(offload.spec.cloud.discovery_servers)
    return tuple(discovery_child(offload.metadata.name, server) for server in servers)


def hosts(offload: RobotOffload, services: Iterable[Manifest]) -> tuple[str, ...]:
    """The addresses of the servers' Services in the cluster, by the servers' ids; empty: not all are known yet.

    Args:
        offload: whose servers.
        services: its own ones, as they are in the cluster.
    """
    by_name = {one["metadata"]["name"]: (one.get("spec") or {}).get("clusterIP") or "" for one in services}
    found = tuple(by_name.get(name, "") for name in names(offload))
    return found if all(host not in ("", "None") for host in found) else ()


def environment(facts: Facts) -> dict[str, str]:
    """Environment of a participant that finds others through the servers."""
    return {"ROS_DISCOVERY_SERVER": ";".join(address(host, PORT.number) for host in facts.discovery_hosts)}


def server_selector(server: int) -> dict[str, str]:
    """What tells one server's pod from the other's."""
    return {SERVER_LABEL: str(server)}


def services(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The Services inside the cluster, for the transports that show them to nobody else."""
    return tuple(
        child(
            offload,
            facts,
            "v1",
            "Service",
            name,
            "discovery",
            {
                "spec": {
                    "type": "ClusterIP",
                    **FOUND_AT_ONCE,
                    "selector": {**selector(offload, "discovery"), **server_selector(server)},
                    "ports": [
                        {
                            "name": PORT.name,
                            "port": PORT.number,
                            "targetPort": PORT.name,
                            "protocol": PORT.protocol,
                        }
                    ],
                }
            },
        )
        for server, name in enumerate(names(offload))
    )


def stateful_sets(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The servers. They never go to zero."""
    return tuple(_stateful_set(offload, facts, server, name) for server, name in enumerate(names(offload)))


def _stateful_set(offload: RobotOffload, facts: Facts, server: int, name: str) -> Manifest:
    container = pod.container(
        "discovery",
        facts.images.discovery,
        ["fast-discovery-server", "-i", str(server), "-l", "0.0.0.0", "-p", str(PORT.number)],  # noqa: S104 - in a pod
        environment={"HOME": pod.TMP},
        resources={"requests": {"cpu": "20m", "memory": "32Mi"}, "limits": {"memory": "256Mi"}},
        extra={
            "ports": [{"name": PORT.name, "containerPort": PORT.number, "protocol": PORT.protocol}],
            # It answers DDS only; that it has opened its port is what can be seen from outside.
            "readinessProbe": {
                "exec": {"command": ["grep", "-q", f":{PORT.number:04X} ", "/proc/net/udp"]},
                "periodSeconds": 5,
                "timeoutSeconds": 2,
            },
        },
    )
    template = pod.pod_template(
        offload,
        "discovery",
        [container],
        read=config_hash("discovery"),
        grace_s=5,
        extra_labels=server_selector(server),
        extra={"affinity": _apart(offload)},
    )
    spec = {
        "replicas": 1,
        "serviceName": name,
        "revisionHistoryLimit": 2,
        "selector": {"matchLabels": {**selector(offload, "discovery"), **server_selector(server)}},
        "template": template,
    }
    return child(offload, facts, "apps/v1", "StatefulSet", name, "discovery", {"spec": spec})


def _apart(offload: RobotOffload) -> Manifest:
    """The servers of one robot on different nodes where there are some, so that they do not fail together."""
    term = {
        "topologyKey": "kubernetes.io/hostname",
        "labelSelector": {"matchLabels": selector(offload, "discovery")},
    }
    preferred = [{"weight": 100, "podAffinityTerm": term}]
    return {"podAntiAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": preferred}}
