"""The resource RobotOffload, version v1alpha1: the one source of the CRD's schema, its docs and its defaults.

Pure: nothing here reads a file, a clock or the environment. Text and objects become a `RobotOffload` through
`parsing`, rules between fields are in `checks`, what the operator reports is in `status`.
"""

from robot_offload.api.v1alpha1.build import BuildFields, GitRepository, NodeBuild, Registry, SecretReference
from robot_offload.api.v1alpha1.nodes import EnvironmentVariable, Node, ParametersFrom, Run, Standby
from robot_offload.api.v1alpha1.outputs import Frame, Output, While
from robot_offload.api.v1alpha1.resources import Resources
from robot_offload.api.v1alpha1.robotoffload import (
    API_VERSION,
    FAST_DDS,
    KIND,
    CloudSide,
    Record,
    RobotOffload,
    RobotOffloadSpec,
    Scale,
    Toleration,
)
from robot_offload.api.v1alpha1.served import Action, Service, State, StateParameters, UsedAction, UsedService, Uses
from robot_offload.api.v1alpha1.switching import HoldDown, Latency, Switching
from robot_offload.api.v1alpha1.topics import QualityOfService, Topics, TopicToCloud
from robot_offload.api.v1alpha1.transport import (
    Certificates,
    DDSRouterTransport,
    DiscoveryServerTransport,
    Expose,
    IssuerReference,
    NodePorts,
    StaticPeersTransport,
    Transport,
    TransportType,
    ZenohTransport,
)

__all__ = [
    "API_VERSION",
    "FAST_DDS",
    "KIND",
    "Action",
    "BuildFields",
    "Certificates",
    "CloudSide",
    "DDSRouterTransport",
    "DiscoveryServerTransport",
    "EnvironmentVariable",
    "Expose",
    "Frame",
    "GitRepository",
    "HoldDown",
    "IssuerReference",
    "Latency",
    "Node",
    "NodeBuild",
    "NodePorts",
    "Output",
    "ParametersFrom",
    "QualityOfService",
    "Record",
    "Registry",
    "Resources",
    "RobotOffload",
    "RobotOffloadSpec",
    "Run",
    "Scale",
    "SecretReference",
    "Service",
    "Standby",
    "State",
    "StateParameters",
    "StaticPeersTransport",
    "Switching",
    "Toleration",
    "TopicToCloud",
    "Topics",
    "Transport",
    "TransportType",
    "UsedAction",
    "UsedService",
    "Uses",
    "While",
    "ZenohTransport",
]
