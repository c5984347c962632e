"""The resource RobotOffload, version v1alpha1: the one source of the CRD's schema, its docs and its defaults.

Pure: nothing here reads a file, a clock or the environment. Text and objects become a `RobotOffload` through
`parsing`, rules between fields are in `checks`.
"""

from robot_offload.api.v1alpha1.nodes import Node, Output, Run, Standby
from robot_offload.api.v1alpha1.robotoffload import API_VERSION, KIND, RobotOffload, RobotOffloadSpec
from robot_offload.api.v1alpha1.switching import HoldDown, Latency, Switching
from robot_offload.api.v1alpha1.topics import QualityOfService, Topics, TopicToCloud
from robot_offload.api.v1alpha1.transport import Transport, ZenohTransport

__all__ = [
    "API_VERSION",
    "KIND",
    "HoldDown",
    "Latency",
    "Node",
    "Output",
    "QualityOfService",
    "RobotOffload",
    "RobotOffloadSpec",
    "Run",
    "Standby",
    "Switching",
    "TopicToCloud",
    "Topics",
    "Transport",
    "ZenohTransport",
]
