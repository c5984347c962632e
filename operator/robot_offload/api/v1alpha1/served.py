"""Services, actions and state: what of a node besides its outputs survives a change of the acting side."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model, map_list
from robot_offload.api.v1alpha1.names import ActionName, ActionType, NodePath, ServiceName, ServiceType, TopicName
from robot_offload.api.v1alpha1.quantities import Duration, Size, UpTo, Within

SNAPSHOT_MAX_AGE_MS: Final = 500
SNAPSHOT_MAX_SIZE: Final = 1024 * 1024
"""Bytes."""
_TIMEOUT = Within("10ms", "10m")


class Service(Model):
    """A service that the node offers; its clients are on the robot."""

    name: ServiceName = Field(description="The full name under which clients know it, e.g. /make_plan.")
    type: ServiceType = Field(description="Its type, e.g. nav_msgs/srv/GetPlan.")
    mode: Literal["Holder", "Idempotent", "Both", "Race"] = Field(
        default="Holder",
        description="Who executes a call. Holder: the acting side, at most once. Idempotent: the acting side; the "
        "other one is asked again when nobody knows whether the call was executed (for queries). Both: both sides, "
        "so that the replica changes too (clear a costmap, load a map); the acting side's answer counts. Race: both, "
        "the first answer wins (expensive pure functions). Default Holder.",
    )
    timeout_ms: Annotated[Duration, _TIMEOUT] = Field(
        default=2_000, description="How long a call waits for its answer. Default 2s, from 10ms to 10m."
    )


class Action(Model):
    """An action that the node offers; its clients are on the robot."""

    name: ActionName = Field(description="The full name under which clients know it, e.g. /follow_path.")
    type: ActionType = Field(description="Its type, e.g. nav2_msgs/action/FollowPath.")
    on_switch: Literal["ResendOnLoss", "Resend", "Continue", "Hold", "Abort"] | None = Field(
        default=None,
        description="What becomes of a running goal when the other side begins to act. ResendOnLoss: a planned switch "
        "waits for the goal's end; after a loss the other side gets the goal, so parts may be executed twice. Resend: "
        "the other side gets the goal at each change and begins anew; a goal that began anew twice keeps its side. "
        "Continue: the same as often as the side changes, for goals that name a place, not a distance. Hold: a "
        "planned switch waits for the goal's end, a loss aborts it. Abort: "
        "the goal ends aborted and its client decides. Default ResendOnLoss; of a node with placement Cloud a goal "
        "runs whoever acts.",
    )
    accept: Literal["Relay", "Holder"] = Field(
        default="Relay",
        description="Who answers a client that sends a goal. Relay: the agent on the robot, at once. Holder: the "
        "acting side's server, which may take longer than a client waits. Default Relay.",
    )
    hold_for_ms: Annotated[Duration, Within("100ms", "10m")] | None = Field(
        default=None,
        description="With onSwitch Hold: the longest wait of a planned switch for the goal's end, from 100ms to 10m; "
        "then the goal ends aborted. Default: no limit.",
    )
    timeout_ms: Annotated[Duration, _TIMEOUT] = Field(
        default=2_000,
        description="How long a goal waits for a server that takes it. Default 2s, from 10ms to 10m.",
    )
    result_timeout_ms: Annotated[Duration, Within("1s", "24h")] = Field(
        default=900_000,
        description="How long a result is kept for a client that asks late. Default 15m, from 1s to 24h.",
    )
    mirror: bool = Field(
        default=False,
        description="Whether live goals run on the Hot replica of the other side too, so that it takes over in the "
        "middle of them. Only with onSwitch Resend or Continue. Default false.",
    )


class UsedService(Model):
    """A service that the node calls."""

    name: ServiceName = Field(description="Its full name, e.g. /map_server/map.")
    type: ServiceType = Field(description="Its type, e.g. nav_msgs/srv/GetMap.")
    timeout_ms: Annotated[Duration, _TIMEOUT] = Field(
        default=2_000, description="How long a call waits for its answer. Default 2s, from 10ms to 10m."
    )


class UsedAction(Model):
    """An action that the node sends goals to."""

    name: ActionName = Field(description="Its full name, e.g. /dock.")
    type: ActionType = Field(description="Its type, e.g. nav2_msgs/action/DockRobot.")
    cancel_after_ms: Annotated[Duration, Within("0s", "1m")] = Field(
        default=500,
        description="How long a goal of the side that acted before runs on after a change, unless the new side sends "
        "one sooner; 0s for arms. Default 500ms, from 0s to 1m.",
    )
    timeout_ms: Annotated[Duration, _TIMEOUT] = Field(
        default=2_000,
        description="How long a goal waits for a server that takes it. Default 2s, from 10ms to 10m.",
    )


class Uses(Model):
    """The services and actions that a node calls and that other nodes offer."""

    services: tuple[UsedService, ...] = Field(
        default=(),
        max_length=16,
        description="The services that it calls, at most 16. Default: none.",
        json_schema_extra=map_list("name"),
    )
    actions: tuple[UsedAction, ...] = Field(
        default=(),
        max_length=16,
        description="The actions that it sends goals to, at most 16. Default: none.",
        json_schema_extra=map_list("name"),
    )


class StateParameters(Model):
    """Parameters that are the same on both sides."""

    nodes: tuple[NodePath, ...] = Field(
        default=(),
        max_length=16,
        description="The nodes whose parameters are copied, child nodes too, e.g. [local_costmap/local_costmap], at "
        "most 16. Default: this node.",
    )
    except_: tuple[Annotated[str, Field(min_length=1, max_length=255)], ...] = Field(
        default=(),
        max_length=64,
        description="Names of parameters that each side keeps for itself, e.g. [use_gpu], at most 64. Default: none.",
    )


class State(Model):
    """A piece of what the node knows: a topic, parameters or a snapshot."""

    topic: TopicName | None = Field(
        default=None, description="A topic that the node publishes, e.g. /amcl_pose. Goes with restore."
    )
    restore: TopicName | None = Field(
        default=None,
        description="The topic of the same type from which the replica takes it, e.g. /initialpose. Goes with topic.",
    )
    parameters: StateParameters | None = Field(
        default=None,
        description="Parameters that were changed on the acting side are set on the other one. {} means all.",
    )
    snapshot: bool = Field(
        default=False,
        description="Whether the node publishes its state as bytes on ~/offload/state and takes it from "
        "~/offload/restore. Default false.",
    )
    max_age_ms: Annotated[Duration, Within("10ms", "1m")] | None = Field(
        default=None,
        description="Of a snapshot: the oldest one with which the other side counts as up to date, from 10ms to 1m. "
        "Default 500ms.",
    )
    max_size: Annotated[Size, UpTo("16Mi")] | None = Field(
        default=None, description="Of a snapshot: the largest one that is taken, at most 16Mi. Default 1Mi."
    )
