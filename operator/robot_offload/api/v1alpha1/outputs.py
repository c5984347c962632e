"""Outputs: the topics that a node publishes, and when their silence is a fault."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model, map_list
from robot_offload.api.v1alpha1.names import ActionName, FrameName, MessageType, TopicName
from robot_offload.api.v1alpha1.quantities import Duration, RateHz, Within
from robot_offload.api.v1alpha1.topics import QualityOfService

DEADLINE_PERIODS: Final = 3
"""Periods of silence of a rated output that count as silent: two lost messages in a row are not a failure."""
DEADLINE_FLOOR_MS: Final = 100
"""Shorter deadlines would judge the scheduler of a busy computer, not the node."""


class While(Model):
    """When a rated output is judged: while an action is executed, or while messages of a topic arrive."""

    actions: tuple[ActionName, ...] = Field(
        default=(),
        max_length=16,
        description="Public names of actions, e.g. [/follow_path, /spin]: the output is judged while a goal of one "
        "of them is executed. Either this or topic.",
    )
    topic: TopicName | None = Field(
        default=None,
        description="A topic, e.g. /image: the output is judged while its messages arrive. Either this or actions.",
    )
    within_ms: Annotated[Duration, Within("10ms", "1m")] | None = Field(
        default=None,
        description="How long after a message of topic the output is still judged, e.g. 200ms, from 10ms to 1m. "
        "Goes with topic.",
    )


class Frame(Model):
    """A transform that duplicated nodes publish on /tf."""

    parent: FrameName = Field(description="The parent frame, e.g. map.")
    child: FrameName = Field(description="The child frame, e.g. odom.")


class Output(Model):
    """A topic that a node publishes. Of nodes that run in the cloud, the agents bring it to the robot."""

    topic: TopicName = Field(description="The full name under which consumers know it, e.g. /cmd_vel.")
    type: MessageType | None = Field(
        default=None,
        description="Its message type, e.g. geometry_msgs/msg/Twist. Default: read from the running system.",
    )
    rate_hz: RateHz | None = Field(
        default=None,
        description="Messages per second of the slower side while it acts; the output's silence is judged "
        "only with a rate. From 0.05 to 1000. Default: not judged.",
    )
    deadline_ms: Annotated[Duration, Within("1ms", "1m")] | None = Field(
        default=None,
        description="Silence of a rated output after which its side counts as failed, from 1ms to 1m. "
        "Default: three periods of the rate, but at least 100ms.",
    )
    qos: QualityOfService | None = Field(
        default=None, description="Quality of service, where it shall differ from the publisher's."
    )
    mirror: bool = Field(
        default=True,
        description="Whether the collected messages also reach consumers in the cloud. Default true.",
    )

    while_: While | None = Field(
        default=None,
        description="When the output is judged, for one that is silent while there is nothing to do. "
        "Default: always, if it has a rate.",
    )
    shared: bool = Field(
        default=False,
        description="Whether others publish on the public topic as well, as on /diagnostics; otherwise that is a "
        "fault. Default false.",
    )
    frames: tuple[Frame, ...] = Field(
        default=(),
        max_length=32,
        description="Of /tf: the transforms that this node publishes; only those of the acting side pass, and others "
        "may publish on /tf as well. At most 32. Default: none.",
        json_schema_extra=map_list("child"),
    )
    max_age_ms: Annotated[Duration, Within("1ms", "10m")] | None = Field(
        default=None,
        description="Of a Cloud node: the oldest message that still reaches the robot, e.g. 500ms, from 1ms to 10m. "
        "Default: switching.maxCommandAge.",
    )

    @property
    def judged_after_ms(self) -> float:
        """The silence that counts as failure in milliseconds; 0 when the output has no rate."""
        if self.rate_hz is None:
            return 0.0
        if self.deadline_ms is not None:
            return float(self.deadline_ms)
        return max(float(DEADLINE_FLOOR_MS), DEADLINE_PERIODS * 1000.0 / self.rate_hz)
