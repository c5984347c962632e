"""What the operator reports about a RobotOffload. Nothing that changes all the time: live numbers are metrics."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model, map_list

CLOUD_TYPES: Final = (
    "SpecValid",
    "ResourcesApplied",
    "ImageBuilt",
    "DiscoveryReady",
    "WorkloadsAvailable",
    "CertificatesReady",
    "AddressesReady",
)
"""What `Ready` sums up, in the order in which it becomes true: whether the cloud can serve the robot."""
ROBOT_TYPES: Final = ("Connected", "ConfigCurrent", "CertificateCurrent")
"""The robot's part. A robot that is switched off is no reason for the cloud not to be ready."""
CONDITION_TYPES: Final = (*CLOUD_TYPES, *ROBOT_TYPES, "Ready")
PROGRESS_TYPES: Final = ("Reconciling", "Stalled")
"""There only while they are true, and only while `Ready` is not: time will tell, or somebody must correct something.
Flux, kpt and `kubectl wait` read them (kstatus)."""

Timestamp = Annotated[str, Field(max_length=64, json_schema_extra={"format": "date-time"})]
Word = Annotated[str, Field(max_length=253)]
Dialled = Annotated[str, Field(max_length=262)]
"""`host:port`."""
Sentence = Annotated[str, Field(max_length=32_768)]


class Condition(Model):
    """One thing that is true, false or unknown about the object, and why."""

    type: Annotated[str, Field(max_length=316)] = Field(
        description="SpecValid, ResourcesApplied, ImageBuilt, DiscoveryReady, WorkloadsAvailable, "
        "CertificatesReady, AddressesReady, or their sum Ready; Connected, ConfigCurrent and CertificateCurrent, about "
        "the robot; Reconciling or Stalled while it is not Ready."
    )
    status: Literal["True", "False", "Unknown"] = Field(description="True, False or Unknown.")
    reason: Annotated[str, Field(min_length=1, max_length=1024)] = Field(
        description="Why, as one CamelCase word for machines."
    )
    message: Sentence = Field(default="", description="Why, and what to do, for people.")
    observed_generation: int | None = Field(
        default=None, description="The generation of the object that this was found for."
    )
    last_transition_time: Timestamp = Field(description="When the status last changed.")


class RobotStatus(Model):
    """The robot as the cloud sees it."""

    connected: bool = Field(default=False, description="Whether the robot's agent is connected.")
    since: Timestamp | None = Field(default=None, description="Since when it is connected, or is not.")
    generation: int | None = Field(
        default=None, description="The generation of this object with whose settings the robot runs."
    )
    last_seen: Timestamp | None = Field(
        default=None, description="When it was last connected; only while it is not connected."
    )
    dials: tuple[Dialled, ...] = Field(
        default=(),
        max_length=16,
        description="Where its bundle looks for the cloud (host:port), as it said last; of transport Zenoh.",
    )


class CertificateStatus(Model):
    """A certificate."""

    serial: Word = Field(description="Its serial number, hexadecimal.")
    not_after: Timestamp = Field(description="When it ends.")


class CertificatesStatus(Model):
    """The certificates of robot and cloud."""

    cloud: CertificateStatus | None = Field(default=None, description="What the cloud's agent shows.")
    bundle: CertificateStatus | None = Field(default=None, description="What a bundle written now holds.")
    robot: CertificateStatus | None = Field(
        default=None, description="What the robot dials with, as it said when it was last connected."
    )


class PinStatus(Model):
    """The pin that is in force."""

    side: Literal["Auto", "Robot", "Cloud"] = Field(
        default="Auto", description="The side that is held: Robot or Cloud; Auto: the policy decides."
    )
    until: Timestamp | None = Field(default=None, description="When that ends; none: when it is taken back.")
    ended: Word = Field(
        default="",
        description="The side and the end of a pin that counts no more, though it stands in the specification.",
    )


class AuditStatus(Model):
    """The robot's audit trail, as it was seen last; written once a minute at most."""

    entries: int = Field(default=0, ge=0, description="The number of its newest entry; 0: none was seen.")
    head: Word = Field(
        default="", description="That entry's number and digest, for `robot-offload audit verify --head`."
    )
    seen: Timestamp | None = Field(default=None, description="When this was written.")


class EndpointStatus(Model):
    """An address on which the cloud listens for the robot."""

    purpose: Word = Field(
        description="What for: pulse, data, pulse-fallback, data-fallback, router or discovery (one for each server)."
    )
    protocol: Literal["UDP", "TCP"] = Field(description="UDP or TCP.")
    host: Word = Field(description="A DNS name or an IP address.")
    port: int = Field(ge=1, le=65535, description="The port.")


class NodeStatus(Model):
    """The replica of one node in the cloud."""

    name: Word = Field(description="The node's name, as in spec.nodes.")
    workload: Word = Field(default="", description="The Deployment that runs it.")
    replicas: int = Field(default=0, ge=0, description="How many pods are wanted.")
    ready: bool = Field(default=False, description="Whether all its pods are ready.")
    message: Sentence = Field(default="", description="What is wrong with it, when something is.")
    image: Annotated[str, Field(max_length=1024)] = Field(
        default="", description="The image that its Deployment runs; one that was built in the cluster by its digest."
    )
    commit: Word = Field(
        default="", description="The commit that the image was built from, when it was built in the cluster."
    )


class RobotOffloadStatus(Model):
    """What the operator has found and done."""

    observed_generation: int | None = Field(
        default=None, description="The generation of the object that this status is about."
    )
    conditions: tuple[Condition, ...] = Field(
        default=(),
        max_length=16,
        description="What is true about the object: SpecValid, ResourcesApplied, ImageBuilt, "
        "DiscoveryReady, WorkloadsAvailable, CertificatesReady, AddressesReady and their sum Ready; Connected, "
        "ConfigCurrent and CertificateCurrent, about the robot; Reconciling or Stalled while it is not Ready.",
        json_schema_extra=map_list("type"),
    )
    placement: Literal["Robot", "Cloud", "Unknown"] = Field(
        default="Unknown", description="The side that acts: Robot, Cloud or Unknown."
    )
    placement_reason: Word = Field(default="", description="Why that side acts, as one CamelCase word.")
    placement_message: Sentence = Field(default="", description="Why that side acts, in words.")
    pin: PinStatus = Field(default_factory=PinStatus, description="The pin that is in force.")
    robot: RobotStatus = Field(default_factory=RobotStatus, description="The robot as the cloud sees it.")
    certificates: CertificatesStatus = Field(
        default_factory=CertificatesStatus, description="The certificates of robot and cloud, as far as they are known."
    )
    audit: AuditStatus = Field(default_factory=AuditStatus, description="The robot's audit trail, as it was seen last.")
    endpoints: tuple[EndpointStatus, ...] = Field(
        default=(),
        max_length=16,
        description="The addresses on which the cloud listens for the robot.",
    )
    nodes: tuple[NodeStatus, ...] = Field(
        default=(),
        max_length=64,
        description="The replicas in the cloud.",
        json_schema_extra=map_list("name"),
    )
    nodes_ready: Word = Field(default="", description="How many of them are ready, e.g. 3/3.")
    replicas: int = Field(default=0, ge=0, le=1, description="Whether the nodes in the cloud run: 1 or 0.")
    selector: Annotated[str, Field(max_length=1024)] = Field(
        default="", description="The label selector of the nodes' pods, for the scale subresource."
    )
