"""Transport: how the two sides reach each other. A union: `type` says which block counts."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from robot_offload.api.v1alpha1.model import NO_SERVER_DEFAULT, Model
from robot_offload.api.v1alpha1.names import Address, AddressRange, DNSName, IPAddress, LabelKey, ObjectName
from robot_offload.api.v1alpha1.quantities import DomainID, Duration, Port, Within

TransportType: TypeAlias = Literal["Zenoh", "DDSRouter", "DiscoveryServer", "StaticPeers"]

BLOCKS: Final[dict[str, tuple[TransportType, ...]]] = {
    "zenoh": ("Zenoh",),
    "dds_router": ("DDSRouter",),
    "discovery_server": ("DiscoveryServer",),
    "static_peers": ("StaticPeers",),
    "expose": ("Zenoh", "DDSRouter", "DiscoveryServer"),
    "certificates": ("Zenoh", "DDSRouter"),
}
"""For each block of Transport (its Python name) the types that it belongs to."""

ONE_DOMAIN: Final[tuple[TransportType, ...]] = ("DiscoveryServer", "StaticPeers")
"""The types that join both sides in one DDS domain."""

NodePort = Annotated[int, Field(ge=1, le=65535)]
"""A port of the cluster's nodes; which ones are free to choose is the cluster's setting (30000 to 32767 mostly)."""


class ZenohTransport(Model):
    """The agents' own sessions: two, both opened by the robot, both mutually authenticated."""

    pulse_port: Port = Field(
        default=7447,
        description="Port on which the cloud agent hears heartbeats and grants (UDP; TCP for the fallback). "
        "Default 7447, from 1 to 65535.",
    )
    data_port: Port = Field(
        default=7448,
        description="Port on which the cloud agent exchanges topics (UDP; TCP for the fallback). Default "
        "7448, from 1 to 65535.",
    )
    fallback: bool = Field(
        default=True,
        description="Whether TLS over TCP is used where UDP does not pass. It is slower to notice losses. "
        "Default true.",
    )


class DDSRouterTransport(Model):
    """A DDS Router on each side, joined by one TCP connection that the robot opens."""

    port: Port = Field(
        default=11666, description="Port on which the cloud's router listens (TCP). Default 11666, from 1 to 65535."
    )
    domain_id: DomainID | None = Field(
        default=None,
        description="The ROS_DOMAIN_ID that the robot's router joins, from 0 to 232. Default: the robot's.",
    )


class DiscoveryServerTransport(Model):
    """The cloud's discovery servers made reachable for the robot, on a network that carries UDP both ways (a VPN)."""


class StaticPeersTransport(Model):
    """Both sides are told each other's addresses, on a network that carries UDP both ways (a VPN, a flat network)."""

    robot: tuple[Address, ...] = Field(
        default=(),
        max_length=16,
        description="Addresses of the robot as the cloud reaches it: IP addresses or DNS names, at most 16. At "
        "least one is needed. Default: none.",
    )
    cloud: tuple[Address, ...] = Field(
        default=(),
        max_length=16,
        description="Addresses of the cloud as the robot reaches it: IP addresses or DNS names, at most 16. "
        "Default: none; then only the cloud looks for the robot.",
    )


class NodePorts(Model):
    """Ports of the cluster's nodes, where the cluster shall not choose them itself."""

    pulse: NodePort | None = Field(
        default=None, description="For heartbeats and grants over UDP (Zenoh). Default: the cluster chooses one."
    )
    data: NodePort | None = Field(
        default=None, description="For topics over UDP (Zenoh). Default: the cluster chooses one."
    )
    pulse_fallback: NodePort | None = Field(
        default=None,
        description="For heartbeats and grants over TCP (Zenoh with fallback). Default: the cluster chooses one.",
    )
    data_fallback: NodePort | None = Field(
        default=None, description="For topics over TCP (Zenoh with fallback). Default: the cluster chooses one."
    )
    router: NodePort | None = Field(
        default=None, description="For the router's connection over TCP (DDSRouter). Default: the cluster chooses one."
    )
    discovery: NodePort | None = Field(
        default=None,
        description="For the first discovery server over UDP (DiscoveryServer); each further server takes the "
        "next port. Default: the cluster chooses them.",
    )


class Expose(Model):
    """How what listens in the cloud becomes reachable for the robot."""

    type: Literal["LoadBalancer", "NodePort", "ClusterIP"] = Field(
        default="LoadBalancer",
        description="The type of the Services: LoadBalancer, NodePort, or ClusterIP where the robot reaches the "
        "cluster's own network. Default LoadBalancer.",
    )
    host: DNSName | None = Field(
        default=None,
        description="The DNS name by which the robot reaches the cloud, e.g. edge.example.com. With it the robot "
        "checks that the cloud's certificate carries this name. Default: the address that the cluster gives; then "
        "the certificate's authority alone, which serves one robot only, proves who answers.",
    )
    address: IPAddress | None = Field(
        default=None,
        description="The address that the load balancer shall use, for instance one that several robots share on "
        "different ports (loadBalancerIP of the Services). Only for type LoadBalancer. Default: the cluster chooses.",
    )
    load_balancer_class: LabelKey | None = Field(
        default=None,
        description="Which load balancer serves the Services (loadBalancerClass). Only for type LoadBalancer. "
        "Default: the cluster's own.",
    )
    source_ranges: tuple[AddressRange, ...] | None = Field(
        default=None,
        max_length=64,
        description="From which ranges of addresses the load balancer lets robots through, e.g. 198.51.100.0/24 "
        "(loadBalancerSourceRanges of the Services), at most 64. Only for type LoadBalancer. Default: from everywhere.",
    )
    annotations: dict[LabelKey, Annotated[str, Field(max_length=4096)]] = Field(
        default_factory=dict,
        max_length=32,
        description="Annotations of the Services, with which many load balancers are set up. Default: none.",
    )
    node_ports: NodePorts | None = Field(
        default=None,
        description="Ports of the cluster's nodes, where they must be known beforehand. Not for type ClusterIP.",
    )


class IssuerReference(Model):
    """An issuer of cert-manager, which signs the certificates of cloud and robot."""

    name: ObjectName = Field(description="The issuer's name.")
    kind: Literal["Issuer", "ClusterIssuer"] = Field(
        default="Issuer", description="Issuer (in this namespace) or ClusterIssuer. Default Issuer."
    )


class Certificates(Model):
    """The certificates with which robot and cloud prove who they are to each other."""

    issuer_ref: IssuerReference | None = Field(
        default=None,
        description="Who signs the certificates. Default: two authorities of this RobotOffload's own, kept by the "
        "operator.",
    )
    duration_ms: Annotated[Duration, Within("24h", "87600h")] = Field(
        default=2160 * 3_600_000,
        description="How long a certificate is valid. Default 2160h, which is 90 days; from 24h to 87600h.",
    )
    renew_before_ms: Annotated[Duration, Within("1h", "43800h")] = Field(
        default=720 * 3_600_000,
        description="How long before its end a certificate is renewed; less than duration. Default 720h, which "
        "is 30 days; from 1h to 43800h.",
    )


class Transport(Model):
    """How robot and cloud are connected. One block belongs to each type; a block of another type is refused."""

    type: TransportType = Field(
        default="Zenoh",
        description="Zenoh: the agents' own sessions, through NAT and firewalls. DDSRouter: two DDS Routers and one "
        "TCP connection that the robot opens. DiscoveryServer: the cloud's Fast DDS discovery servers, reachable "
        "for the robot. StaticPeers: both sides know each other's addresses. The last two need a network that "
        "carries UDP both ways, such as a VPN. Default Zenoh.",
    )
    zenoh: ZenohTransport = Field(
        default_factory=ZenohTransport,
        description="Settings of type Zenoh; left out with any other type.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )
    dds_router: DDSRouterTransport = Field(
        default_factory=DDSRouterTransport,
        description="Settings of type DDSRouter; left out with any other type.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )
    discovery_server: DiscoveryServerTransport = Field(
        default_factory=DiscoveryServerTransport,
        description="Settings of type DiscoveryServer; left out with any other type.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )
    static_peers: StaticPeersTransport = Field(
        default_factory=StaticPeersTransport,
        description="Settings of type StaticPeers, which needs them; left out with any other type.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )
    expose: Expose = Field(
        default_factory=Expose,
        description="How what listens in the cloud becomes reachable for the robot. Not for type StaticPeers, "
        "where nothing listens. Default: by load balancers.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )
    certificates: Certificates = Field(
        default_factory=Certificates,
        description="The certificates of types Zenoh and DDSRouter; left out with the other types.",
        json_schema_extra=NO_SERVER_DEFAULT,
    )

    @property
    def agent_link(self) -> Literal["zenoh", "ros"]:
        """What the agents talk over: sessions of their own, or topics of a DDS network that joins both sides."""
        return "zenoh" if self.type == "Zenoh" else "ros"
