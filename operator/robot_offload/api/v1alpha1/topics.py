"""Topics: what crosses from the robot to the cloud, and the quality of service with which it is taken."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model, map_list
from robot_offload.api.v1alpha1.names import MessageType, TopicName
from robot_offload.api.v1alpha1.quantities import Duration, RateHz, Within


class QualityOfService(Model):
    """Overrides of what is otherwise read from the publisher."""

    reliability: Literal["Reliable", "BestEffort"] | None = Field(
        default=None,
        description="Whether lost messages are sent again. Reliable or BestEffort; default: as the publisher does.",
    )
    durability: Literal["Volatile", "TransientLocal"] | None = Field(
        default=None,
        description="Whether a late subscriber gets the last messages. Volatile or TransientLocal; default: "
        "as the publisher does.",
    )
    depth: int = Field(
        default=10,
        ge=1,
        le=1000,
        description="How many messages a queue keeps; one of a shared output at least 100. Default 10, from 1 to 1000.",
    )


class TopicToCloud(Model):
    """A topic of the robot that the cloud's replicas need as an input."""

    name: TopicName = Field(description="The topic's full name, as `ros2 topic list` shows it, e.g. /scan.")
    type: MessageType | None = Field(
        default=None,
        description="Its message type, e.g. sensor_msgs/msg/LaserScan. Default: read from the running system.",
    )
    max_age_ms: Annotated[Duration, Within("1ms", "10m")] | None = Field(
        default=None,
        description="The cloud is not fit to act when the newest message there is older than this, e.g. "
        "200ms, from 1ms to 10m. Default: no limit.",
    )
    max_rate_hz: RateHz | None = Field(
        default=None,
        description="Messages per second sent at most; those in between are left out. From 0.05 to 1000. "
        "Default: all are sent.",
    )
    latched: bool = Field(
        default=False,
        description="Whether the topic is published once and kept (transient local), such as a map; the "
        "cloud is not ready before it has the last value. Default false.",
    )
    min_rate_hz: RateHz | None = Field(
        default=None,
        description="Messages per second down to which the agent thins the topic, evenly, when the link does not carry "
        "more; not less than one in maxAge. From 0.05 to 1000. Default: it is not thinned, what would have to wait "
        "is left out.",
    )
    priority: Literal["High", "Normal", "Low"] = Field(
        default="Normal",
        description="Which topics go first when the link does not carry all: High, Normal or Low; those with minRate "
        "are thinned from Low to High. Default Normal.",
    )
    latest: bool = Field(
        default=False,
        description="Whether only the newest message waits when the link has no room, and is sent as soon as there is "
        "some, as for camera images. Not for latched topics. Default false.",
    )
    qos: QualityOfService | None = Field(
        default=None, description="Quality of service, where it shall differ from the publisher's."
    )


class Topics(Model):
    """Topics that cross between the sides. Collected outputs (see nodes) cross by themselves."""

    to_cloud: tuple[TopicToCloud, ...] = Field(
        default=(),
        max_length=128,
        description="Topics of the robot that are sent to the cloud, at most 128. Default: none.",
        json_schema_extra=map_list("name"),
    )
