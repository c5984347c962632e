"""The resource as a whole: one robot, its application, and how it shares it with the cloud."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from robot_offload.api.v1alpha1.build import Registry
from robot_offload.api.v1alpha1.model import Model, map_list
from robot_offload.api.v1alpha1.names import (
    ImageName,
    LabelKey,
    LabelValue,
    Namespace,
    ObjectName,
    ResourceName,
    RmwName,
    ServiceName,
    SetupFile,
)
from robot_offload.api.v1alpha1.nodes import Node
from robot_offload.api.v1alpha1.outputs import Output
from robot_offload.api.v1alpha1.pod_spec import PodSpec
from robot_offload.api.v1alpha1.quantities import DomainID, Duration, Size, UpTo, Within
from robot_offload.api.v1alpha1.switching import Switching
from robot_offload.api.v1alpha1.topics import Topics
from robot_offload.api.v1alpha1.transport import Transport

API_VERSION = "robotoffload.dev/v1alpha1"
KIND = "RobotOffload"

FAST_DDS: Final = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
"""The ROS middlewares that understand discovery servers, and so those that run in a cluster."""


class ObjectMeta(Model):
    """What Kubernetes keeps about every object; only the name is read here."""

    name: ResourceName = Field(description="The robot's name: lower-case letters, digits and dashes, at most 63.")
    namespace: ResourceName | None = Field(default=None, description="The Kubernetes namespace of the object.")
    labels: dict[LabelKey, LabelValue] = Field(default_factory=dict, description="Labels of the object.")
    annotations: dict[LabelKey, str] = Field(default_factory=dict, description="Annotations of the object.")


class Interfaces(Model):
    """Where the robot has message packages of your own."""

    setup: SetupFile = Field(
        description="The setup script, on the robot, of the workspace with the message packages that the agent must "
        "import, e.g. /opt/ws/install/setup.bash. The bundle starts the agent with it."
    )


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
    interfaces: Interfaces | None = Field(
        default=None,
        description="Where the robot has message packages of your own. Default: those of the distribution alone.",
    )


class ImagePullSecret(Model):
    """A Secret with which images are fetched."""

    name: ObjectName = Field(description="The Secret's name, in the same Kubernetes namespace.")


class Toleration(Model):
    """A taint of the cluster's nodes that the pods put up with."""

    key: LabelKey | None = Field(
        default=None, description="The taint's key. Default: every key (with operator Exists)."
    )
    operator: Literal["Equal", "Exists"] = Field(
        default="Equal", description="Equal: the value must be the same. Exists: any value. Default Equal."
    )
    value: LabelValue | None = Field(default=None, description="The taint's value, for operator Equal.")
    effect: Literal["NoSchedule", "PreferNoSchedule", "NoExecute"] | None = Field(
        default=None, description="NoSchedule, PreferNoSchedule or NoExecute. Default: every effect."
    )
    toleration_seconds: Annotated[int, Field(ge=0, le=86_400)] | None = Field(
        default=None,
        description="How many seconds a pod stays once a NoExecute taint appears, from 0 to 86400. Default: for ever.",
    )


class CloudAgent(Model):
    """The agent in the cloud."""

    image: ImageName | None = Field(
        default=None,
        description="The agent's image, with your message packages and distribution: `robot-offload build --agent` "
        "makes one. The container of the bundle is the same. Default: the image that the operator was given.",
    )


class CloudSide(Model):
    """ROS 2 in the cloud, and what all pods there have in common."""

    domain_id: DomainID | None = Field(
        default=None,
        description="The ROS_DOMAIN_ID of the cloud's nodes, from 0 to 232. Default: the robot's.",
    )
    rmw: RmwName | None = Field(
        default=None,
        description="The ROS middleware in the cloud. A cluster needs rmw_fastrtps_cpp or "
        "rmw_fastrtps_dynamic_cpp, because nodes find each other there through Fast DDS discovery servers. "
        "Default: the robot's.",
    )
    discovery_servers: Annotated[int, Field(ge=1, le=4)] = Field(
        default=2,
        description="How many discovery servers run in the cloud; one may fail when there are two. Default 2, "
        "from 1 to 4.",
    )
    image_pull_secrets: tuple[ImagePullSecret, ...] = Field(
        default=(),
        max_length=16,
        description="Secrets with which the pods' images are fetched, at most 16. Default: none.",
        json_schema_extra=map_list("name"),
    )
    agent: CloudAgent = Field(default_factory=CloudAgent, description="The agent in the cloud.")
    registry: Registry | None = Field(
        default=None,
        description="Where images that are built in the cluster are pushed to. Nodes with a build block need it. "
        "Default: none.",
    )
    node_selector: dict[LabelKey, LabelValue] = Field(
        default_factory=dict,
        max_length=32,
        description="Labels of the cluster's nodes on which the pods may run. Default: none.",
    )
    tolerations: tuple[Toleration, ...] = Field(
        default=(),
        max_length=16,
        description="Taints of the cluster's nodes that the pods put up with, at most 16. Default: none.",
    )
    pod_spec: PodSpec = Field(
        default_factory=dict,
        description="Fields of the pods' specifications in Kubernetes' own words, for all pods: affinity, "
        "containers (resources and volumeMounts by name: agent, reporter, discovery, router, tunnel, node), dnsConfig, "
        "priorityClassName, resourceClaims, schedulerName, tolerations, topologySpreadConstraints, volumes. Laid over "
        "those that the operator makes. Default: none.",
    )
    run_as_user: Annotated[int, Field(ge=1, le=2_147_483_647)] | None = Field(
        default=1000,
        description="The user id of the pods' processes, not 0 (root). null leaves it to the cluster, as OpenShift "
        "wants. Default 1000.",
    )


class Driver(Model):
    """The node that moves the robot. It must have a command time-out of its own: this is no replacement."""

    inhibit_service: ServiceName | None = Field(
        default=None,
        description="A std_srvs/srv/SetBool service that stops the robot and holds it while a core node is "
        "not active, e.g. /wheels_control/inhibit. Default: none is called.",
    )


class Scale(Model):
    """When the cloud side goes to sleep."""

    idle_timeout_ms: Annotated[Duration, Within("30s", "168h", or_zero=True)] = Field(
        default=600_000,
        description="After this time without the robot its nodes in the cloud go to zero pods; they return with the "
        "robot. 0s: never. Default 10m, from 30s to 168h.",
    )


class Record(Model):
    """What the robot's agent records for people: MCAP files for Foxglove, Lichtblick, PlotJuggler and rosbag2."""

    switches: bool = Field(
        default=False,
        description="Whether the robot's agent writes a recording of each changeover into its state folder. Needs "
        "`robot-offload-agent[record]` on the robot. Default false.",
    )
    before_ms: Annotated[Duration, Within("0s", "5m")] = Field(
        default=20_000, description="How much of the time before a changeover is recorded. Default 20s, from 0s to 5m."
    )
    after_ms: Annotated[Duration, Within("0s", "5m")] = Field(
        default=10_000, description="How much of the time after a changeover is recorded. Default 10s, from 0s to 5m."
    )
    keep: Annotated[int, Field(ge=1, le=1_000)] = Field(
        default=50, description="How many recordings stay on the robot; the oldest go. Default 50, from 1 to 1000."
    )
    max_size: Annotated[Size, UpTo("1024Mi")] = Field(
        default=64 * 1024 * 1024,
        description="The largest size of one recording, and of the memory in which the agent keeps what may be "
        "recorded, e.g. 64Mi; counted in whole Mi. Default 64Mi, at most 1024Mi.",
    )


class RobotOffloadSpec(Model):
    """What the user wants."""

    robot: RobotSide = Field(default_factory=RobotSide, description="ROS 2 on the robot.")
    cloud: CloudSide = Field(
        default_factory=CloudSide, description="ROS 2 in the cloud, and what all pods there have in common."
    )
    transport: Transport = Field(default_factory=Transport, description="How robot and cloud are connected.")
    topics: Topics = Field(default_factory=Topics, description="Topics that cross between the sides.")
    driver: Driver = Field(default_factory=Driver, description="The node that moves the robot.")
    nodes: tuple[Node, ...] = Field(
        min_length=1,
        max_length=64,
        description="The application's nodes, in the order in which they are brought up. At least one, at most 64.",
        json_schema_extra=map_list("name"),
    )
    switching: Switching = Field(default_factory=Switching, description="When and how the acting side changes.")
    replicas: Annotated[int, Field(ge=0, le=1)] = Field(
        default=1,
        description="1: the nodes in the cloud run; 0: they do not, whatever the robot does (`kubectl scale`). "
        "Default 1, from 0 to 1.",
    )
    scale: Scale = Field(default_factory=Scale, description="When the cloud side goes to sleep.")
    record: Record = Field(default_factory=Record, description="What the robot's agent records for people.")

    @property
    def cloud_domain_id(self) -> int:
        """The cloud's domain: its own, or else the robot's."""
        return self.robot.domain_id if self.cloud.domain_id is None else self.cloud.domain_id

    @property
    def cloud_rmw(self) -> str:
        """The cloud's ROS middleware: its own, or else the robot's."""
        return self.cloud.rmw or self.robot.rmw

    @property
    def cloud_nodes(self) -> tuple[Node, ...]:
        """The nodes with a replica in the cloud, in bring-up order."""
        return tuple(node for node in self.nodes if node.in_cloud)

    @property
    def built_nodes(self) -> tuple[Node, ...]:
        """The nodes whose image in the cloud is built in the cluster, in bring-up order."""
        return tuple(node for node in self.cloud_nodes if node.build is not None)

    @property
    def collected_outputs(self) -> tuple[tuple[Node, Output], ...]:
        """The outputs that reach the robot through the agents, with their nodes.

        Of a duplicated node one side's messages pass; of a node that only the cloud has, those that are new enough.
        """
        return tuple((node, output) for node in self.nodes if node.in_cloud for output in node.outputs)


class RobotOffload(Model):
    """A robot that shares its application with the cloud."""

    api_version: Literal["robotoffload.dev/v1alpha1"] = Field(
        description="The version of this format: robotoffload.dev/v1alpha1."
    )
    kind: Literal["RobotOffload"] = Field(description="The kind of object: RobotOffload.")
    metadata: ObjectMeta = Field(description="The object's name.")
    spec: RobotOffloadSpec = Field(description="What the user wants.")
