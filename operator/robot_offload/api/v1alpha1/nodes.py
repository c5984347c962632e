"""Nodes: which run where, how they are started, and which of their outputs are collected."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.names import (
    ExecutableName,
    ImageName,
    MessageType,
    NodeName,
    PackageName,
    TopicName,
)
from robot_offload.api.v1alpha1.quantities import Duration, RateHz, Within
from robot_offload.api.v1alpha1.topics import QualityOfService

DEADLINE_PERIODS: Final = 3
"""Periods of silence of a rated output that count as silent: two lost messages in a row are not a failure."""
DEADLINE_FLOOR_MS: Final = 100
"""Shorter deadlines would judge the scheduler of a busy computer, not the node."""

_SCALARS = (bool, int, float, str)
_PARAMETER = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")


def _check_parameters(value: Any) -> Any:
    """ROS parameters: names to truth values, numbers, texts, lists of one of these, or further mappings."""
    if not isinstance(value, dict):
        raise ValueError("must be a mapping of parameter names to values")
    for name, item in value.items():
        if not isinstance(name, str) or not _PARAMETER.fullmatch(name):
            raise ValueError(f"{str(name)[:40]!r} is not a parameter name; use letters, digits and underscores")
        _check_parameter(name, item)
    return value


def _check_parameter(name: str, value: Any) -> None:
    if isinstance(value, dict):
        _check_parameters(value)
    elif isinstance(value, tuple | list):
        if not value:
            raise ValueError(f"{name} is an empty list; ROS 2 cannot tell its type, leave the parameter out")
        if len({type(item) for item in value}) > 1 or not isinstance(value[0], _SCALARS):
            raise ValueError(f"{name} is a list of different things; ROS 2 takes lists of one plain type")
    elif not isinstance(value, _SCALARS):
        raise ValueError(f"{name} has no value; write one or leave the parameter out")


Parameters = Annotated[
    dict[str, Any],
    BeforeValidator(_check_parameters),
    WithJsonSchema({"type": "object", "x-kubernetes-preserve-unknown-fields": True}),
]
"""Values of ROS parameters as in a parameter file: `{rate_hz: 20.0, plugins: {speed: 0.6}}`."""


def _check_argument(text: str) -> str:
    if not text or "\0" in text:
        raise ValueError("must not be empty")
    return text


Argument = Annotated[str, AfterValidator(_check_argument), WithJsonSchema({"type": "string", "minLength": 1})]


class Run(Model):
    """How a node is started: a command, or an executable of a ROS package."""

    command: tuple[Argument, ...] = Field(
        default=(),
        description="The program and its arguments, e.g. [python3, controller.py]; files are relative to the "
        "folder of this specification. ROS arguments are added. Either this, or package and executable.",
    )
    package: PackageName | None = Field(
        default=None,
        description="The ROS package of the executable, e.g. nav2_controller. Instead of command.",
    )
    executable: ExecutableName | None = Field(
        default=None, description="The executable in that package, as for `ros2 run`, e.g. controller_server."
    )
    parameters: Parameters = Field(
        default_factory=dict,
        description="ROS parameters of the node on both sides, e.g. {rate_hz: 20.0}. Default: none.",
    )
    cloud_parameters: Parameters = Field(
        default_factory=dict,
        description="ROS parameters that differ in the cloud; they are laid over `parameters`. Default: none.",
    )
    remap: dict[Argument, Argument] = Field(
        default_factory=dict,
        description="Remapping of names, from: to, e.g. {cmd_vel_nav: /cmd_vel}. Outputs are remapped on top "
        "of it. Default: none.",
    )


class Output(Model):
    """A topic that a node publishes. Of a duplicated node it is collected: one side's messages pass."""

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

    @property
    def judged_after_ms(self) -> float:
        """The silence that counts as failure in milliseconds; 0 when the output has no rate."""
        if self.rate_hz is None:
            return 0.0
        if self.deadline_ms is not None:
            return float(self.deadline_ms)
        return max(float(DEADLINE_FLOOR_MS), DEADLINE_PERIODS * 1000.0 / self.rate_hz)


class Standby(Model):
    """What a duplicated node does on the side that does not act."""

    robot: Literal["Warm", "Hot"] = Field(
        default="Warm",
        description="On the robot while the cloud acts: Warm (configured, inactive) or Hot (active, its "
        "output held back; takes over at once). Default Warm.",
    )
    cloud: Literal["Warm", "Hot"] = Field(
        default="Warm",
        description="In the cloud while the robot acts: Warm (configured, inactive) or Hot (active, its "
        "output held back). Default Warm.",
    )


class Node(Model):
    """One ROS 2 node of the application."""

    name: NodeName = Field(description="The node's name without its namespace, e.g. controller_server.")
    placement: Literal["Robot", "Cloud", "Duplicated"] = Field(
        description="Where it runs: Robot, Cloud, or Duplicated (a replica on each side, one acts)."
    )
    core: bool = Field(
        default=False,
        description="Whether the robot must not move without it: when it is not active, the driver is "
        "inhibited. Default false.",
    )
    lifecycle: bool = Field(
        default=True,
        description="Whether it is a managed (lifecycle) node. Duplicated nodes must be. Default true.",
    )
    standby: Standby = Field(
        default_factory=Standby,
        description="What its replica on the side that does not act does. Only for Duplicated nodes.",
    )
    run: Run | None = Field(default=None, description="How it is started. Without it, something else starts the node.")
    image: ImageName | None = Field(
        default=None,
        description="The container image of its replica in the cloud, e.g. registry.example/nav2:1.",
    )
    outputs: tuple[Output, ...] = Field(
        default=(),
        description="The topics it publishes that somebody else consumes. Default: none.",
    )

    @property
    def duplicated(self) -> bool:
        """Whether there is a replica on each side."""
        return self.placement == "Duplicated"
