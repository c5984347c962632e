"""The resource as a whole: one robot, its application, and how it shares it with the cloud."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.names import Namespace, ResourceName, RmwName, ServiceName
from robot_offload.api.v1alpha1.nodes import Node, Output
from robot_offload.api.v1alpha1.quantities import DomainID
from robot_offload.api.v1alpha1.switching import Switching
from robot_offload.api.v1alpha1.topics import Topics
from robot_offload.api.v1alpha1.transport import Transport

API_VERSION = "robotoffload.dev/v1alpha1"
KIND = "RobotOffload"


class ObjectMeta(Model):
    """What Kubernetes keeps about every object; only the name is read here."""

    name: ResourceName = Field(description="The robot's name: lower-case letters, digits and dashes, at most 63.")
    namespace: ResourceName | None = Field(default=None, description="The Kubernetes namespace of the object.")
    labels: dict[str, str] = Field(default_factory=dict, description="Labels of the object.")
    annotations: dict[str, str] = Field(default_factory=dict, description="Annotations of the object.")


class RobotSide(Model):
    """ROS 2 on the robot."""

    ros_distro: Literal["humble", "jazzy", "kilted"] = Field(
        default="jazzy", description="The ROS 2 distribution: humble, jazzy or kilted. Default jazzy."
    )
    rmw: RmwName = Field(
        default="rmw_fastrtps_cpp",
        description="The ROS middleware on the robot (RMW_IMPLEMENTATION). Default rmw_fastrtps_cpp.",
    )
    domain_id: DomainID = Field(
        default=0, description="The robot's ROS_DOMAIN_ID. Default 0, from 0 to 232 (use 0 to 101 on Linux)."
    )
    namespace: Namespace = Field(
        default="/", description="The ROS namespace of the robot's nodes and of their replicas. Default /."
    )


class CloudSide(Model):
    """ROS 2 in the cloud."""

    domain_id: DomainID | None = Field(
        default=None,
        description="The ROS_DOMAIN_ID of the cloud's nodes, from 0 to 232. Default: the robot's.",
    )


class Driver(Model):
    """The node that moves the robot. It must have a command time-out of its own: this is no replacement."""

    inhibit_service: ServiceName | None = Field(
        default=None,
        description="A std_srvs/srv/SetBool service that stops the robot and holds it while a core node is "
        "not active, e.g. /wheels_control/inhibit. Default: none is called.",
    )


class RobotOffloadSpec(Model):
    """What the user wants."""

    robot: RobotSide = Field(default_factory=RobotSide, description="ROS 2 on the robot.")
    cloud: CloudSide = Field(default_factory=CloudSide, description="ROS 2 in the cloud.")
    transport: Transport = Field(default_factory=Transport, description="How the two sides are connected.")
    topics: Topics = Field(default_factory=Topics, description="Topics that cross between the sides.")
    driver: Driver = Field(default_factory=Driver, description="The node that moves the robot.")
    nodes: Annotated[tuple[Node, ...], Field(min_length=1)] = Field(
        description="The application's nodes, in the order in which they are brought up. At least one."
    )
    switching: Switching = Field(default_factory=Switching, description="When and how the acting side changes.")

    @property
    def cloud_domain_id(self) -> int:
        """The cloud's domain: its own, or else the robot's."""
        return self.robot.domain_id if self.cloud.domain_id is None else self.cloud.domain_id

    @property
    def collected_outputs(self) -> tuple[tuple[Node, Output], ...]:
        """The outputs of duplicated nodes, with their nodes: those of which one side's messages pass."""
        return tuple((node, output) for node in self.nodes if node.duplicated for output in node.outputs)


class RobotOffload(Model):
    """A robot that shares its application with the cloud."""

    api_version: Literal["robotoffload.dev/v1alpha1"] = Field(
        description="The version of this format: robotoffload.dev/v1alpha1."
    )
    kind: Literal["RobotOffload"] = Field(description="The kind of object: RobotOffload.")
    metadata: ObjectMeta = Field(description="The object's name.")
    spec: RobotOffloadSpec = Field(description="What the user wants.")
