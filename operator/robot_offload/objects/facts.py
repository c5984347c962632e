"""The facts about the cluster that rendering needs. The controller gathers them; nothing here makes requests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

BUILDER: Final = "quay.io/buildah/stable:v1.42.2"
"""buildah as its makers publish it, with a user (uid 1000) that may use further user ids."""

HOME: Final = "robot-offload-system"
"""The operator's default namespace."""

Purpose: TypeAlias = Literal["pulse", "data", "pulse-fallback", "data-fallback", "discovery", "router"]


@dataclass(frozen=True, slots=True)
class Images:
    """The container images of our own programs, and of the one that builds images.

    Attributes:
        agent: the cloud agent; usually built on the user's own interfaces.
        operator: the operator, which contains the reporter as well.
        discovery: Fast DDS with its discovery server.
        router: the DDS Router.
        git: git and ssh, which fetch the source of a build; empty: this cluster builds nothing.
        builder: buildah, for nodes that are built in the cluster.
    """

    agent: str
    operator: str
    discovery: str
    router: str
    git: str = ""
    builder: str = BUILDER


@dataclass(frozen=True, slots=True)
class Endpoint:
    """An address at which the robot reaches the cloud.

    Attributes:
        purpose: of the listener.
        protocol: UDP or TCP.
        host: DNS name or IP address, without brackets.
        port: as seen from outside.
    """

    purpose: Purpose
    protocol: Literal["UDP", "TCP"]
    host: str
    port: int

    @property
    def address(self) -> str:
        """`host:port`, with brackets around an IPv6 address."""
        return address(self.host, self.port)


def address(host: str, port: int) -> str:
    """Return `host:port`, with brackets around an IPv6 address."""
    return f"[{host}]:{port}" if ":" in host and not host.startswith("[") else f"{host}:{port}"


@dataclass(frozen=True, slots=True)
class Network:
    """The cluster administrator's decisions about network policies.

    Attributes:
        policies: whether to create ours; without them only those of the namespace apply.
        dns: networks of the name servers; empty: any.
        api_server: networks of the API servers; empty: any.
        metrics_from: namespaces whose pods may read the metrics beside the agents.
        api_server_from: networks from which API servers reach the reporters, for readers through the API server's
            proxy; empty: none are let in.
    """

    policies: bool = True
    dns: tuple[str, ...] = ()
    api_server: tuple[str, ...] = ()
    metrics_from: tuple[str, ...] = ()
    api_server_from: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Facts:
    """The part of the cluster's state on which the children depend.

    Attributes:
        namespace: the Kubernetes namespace of the RobotOffload.
        uid: of the RobotOffload: it owns the children, and agents with another one are ignored.
        generation: of its specification; the agents report which one they run.
        images: of our own programs.
        nodes_wanted: False: the nodes have no pods (the robot is gone for long, or spec.replicas is 0).
        robot_connected: whether the robot is connected now; Cold nodes have pods only then.
        endpoints: the addresses known so far, from `transport.observed_endpoints`.
        discovery_hosts: addresses of the discovery servers in the cluster, by their ids; empty: not known yet, and what
            needs them is not rendered.
        certificate_hash: of the Secret of the cloud's certificate; a renewed one rolls the pods that read it.
        certificate_answer: to the robot's request for a certificate, in the robot's form; empty: there is no request.
        user_config_hashes: of the ConfigMaps of `parametersFrom`, by `name/key`; empty text: missing.
        user_configs: their content, by `name/key`; replicas get a copy with their own names.
        load_balancer_node_ports: whether Services of type LoadBalancer get node ports, too.
        network: decisions about network policies.
        home: the operator's own namespace, which holds the keys of the robots' authorities.
        author: who changed the specification last, and when, for the robots' audit trails; empty: not known.
        identity: the uid by which the robot knows its cloud; empty: `uid`.
        pull_secrets: names of Secrets in the namespace for pulling the images of all robots.
        pod_spec: the cluster administrator's fields for all pods.
        built: the images of nodes that are built in the cluster, by node; unfinished ones are missing.
    """

    namespace: str
    uid: str
    generation: int
    images: Images
    nodes_wanted: bool
    robot_connected: bool = False
    endpoints: tuple[Endpoint, ...] = ()
    discovery_hosts: tuple[str, ...] = ()
    certificate_hash: str = ""
    certificate_answer: str = ""
    user_config_hashes: Mapping[str, str] = field(default_factory=dict)
    user_configs: Mapping[str, str] = field(default_factory=dict)
    load_balancer_node_ports: bool = True
    network: Network = field(default_factory=Network)
    home: str = HOME
    built: Mapping[str, str] = field(default_factory=dict)
    author: str = ""
    identity: str = ""
    pull_secrets: tuple[str, ...] = ()
    pod_spec: Mapping[str, Any] = field(default_factory=dict)

    def endpoints_for(self, *purposes: Purpose) -> tuple[Endpoint, ...]:
        """Return the known addresses of these purposes, in the order of `purposes`."""
        return tuple(found for purpose in purposes for found in self.endpoints if found.purpose == purpose)


def default_images(version: str) -> Images:
    """Return our own images of one version, the default."""
    return Images(
        *(f"registry.robotoffload.dev/{name}:{version}" for name in ("agent", "operator", "discovery", "router", "git"))
    )
