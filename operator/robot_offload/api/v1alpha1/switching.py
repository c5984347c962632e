"""Switching: when to act where, how fast a loss is noticed, and how careful the return is."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.names import TopicGlob
from robot_offload.api.v1alpha1.quantities import Duration, Size, UpTo, Within


class Latency(Model):
    """The rule for the loop: act in the cloud while loop latency + cloudPeriod <= robotPeriod + tolerance."""

    robot_period_ms: Annotated[Duration, Within("1ms", "10s")] = Field(
        default=50,
        description="Time between two outputs of the robot's replica. Default 50ms, from 1ms to 10s.",
    )
    cloud_period_ms: Annotated[Duration, Within("1ms", "10s")] = Field(
        default=20,
        description="Time between two outputs of the cloud's replica. Default 20ms, from 1ms to 10s.",
    )
    tolerance_ms: Annotated[Duration, Within("0s", "10s")] = Field(
        default=30,
        description="How much slower the whole loop through the cloud may be than the robot alone, as the "
        "price for a better result. Default 30ms, from 0s to 10s.",
    )

    @property
    def allowed_loop_ms(self) -> int:
        """Loop latency (up and down) at which the cloud is still worth it; the rule solved for the latency."""
        return self.robot_period_ms + self.tolerance_ms - self.cloud_period_ms

    @property
    def slower_period_ms(self) -> int:
        """The longer of the two replicas' periods."""
        return max(self.robot_period_ms, self.cloud_period_ms)


HEARTBEATS_MS: Final = {"Responsive": 10, "Balanced": 20, "Patient": 50}
"""Milliseconds between the heartbeats of each profile: the three that `make bench` measures (docs/benchmarks.md)."""

LONGEST_LEASE_MS: Final = 30_000
LARGEST_AGE_MS: Final = 10_000


def default_loss_timeout_ms(heartbeat_period_ms: int) -> int:
    """Return the silence that counts as a loss when none is given: four beats are missing, a fifth is not due."""
    return heartbeat_period_ms * 9 // 2


def default_lease_ms(loss_timeout_ms: int, latency: Latency, heartbeat_period_ms: int) -> int:
    """Return the lease when none is given: three heartbeats longer than it must be, within the range of the field."""
    needed_ms = loss_timeout_ms + max(0, latency.allowed_loop_ms) + 5 * heartbeat_period_ms
    return min(LONGEST_LEASE_MS, max(50, needed_ms))


def default_max_command_age_ms(loss_timeout_ms: int, latency: Latency) -> int:
    """Return the largest age of a command when none is given: of a link as slow as allowed, about to be lost."""
    return min(LARGEST_AGE_MS, max(0, latency.allowed_loop_ms) + loss_timeout_ms)


class HoldDown(Model):
    """How long the cloud is left alone after a loss, before it may act again."""

    initial_ms: Annotated[Duration, Within("0s", "10m")] = Field(
        default=1_000, description="Wait after the first loss. Default 1s, from 0s to 10m."
    )
    max_ms: Annotated[Duration, Within("0s", "1h")] = Field(
        default=30_000, description="The wait doubles with each flap up to this. Default 30s, from 0s to 1h."
    )
    flap_window_ms: Annotated[Duration, Within("0s", "1h")] = Field(
        default=5_000,
        description="A stay in the cloud that ends by a loss sooner than this is a flap. Default 5s, from 0s to 1h.",
    )


class Switching(Model):
    """When and how the acting side changes."""

    prefer: Literal["Cloud", "Robot"] = Field(
        default="Cloud", description="The side that acts when both can: Cloud or Robot. Default Cloud."
    )
    profile: Literal["Responsive", "Balanced", "Patient"] = Field(
        default="Balanced",
        description="How fast a lost link is noticed, in one word; what is not given below follows from it. "
        "Responsive: a heartbeat every 10ms, a loss after 45ms. Balanced: 20ms and 90ms. Patient: 50ms and 225ms, for "
        "links that pause, and for fewer packets. Default Balanced.",
    )
    heartbeat_period_ms: Annotated[Duration, Within("5ms", "1s")] = Field(
        default_factory=lambda given: HEARTBEATS_MS[given["profile"]],
        description="Time between two heartbeats, each way. Default: the profile's, 20ms for Balanced; from 5ms to 1s.",
    )
    latency: Latency = Field(default_factory=Latency, description="The loop latency up to which the cloud is worth it.")
    loss_timeout_ms: Annotated[Duration, Within("15ms", "10s")] = Field(
        default_factory=lambda given: default_loss_timeout_ms(given["heartbeat_period_ms"]),
        description="Silence of good heartbeats that counts as a lost link. More than two heartbeat periods "
        "and no multiple of one, so that the last beat is clearly in time or late. Default: four and a half heartbeat "
        "periods, 90ms for Balanced; from 15ms to 10s.",
    )
    lease_ms: Annotated[Duration, Within("50ms", "30s")] = Field(
        default_factory=lambda given: default_lease_ms(
            given["loss_timeout_ms"], given["latency"], given["heartbeat_period_ms"]
        ),
        description="How long the cloud may go on without hearing the robot. At least lossTimeout + the "
        "allowed loop latency + two heartbeats. Default: lossTimeout + the allowed loop latency + five heartbeats, "
        "250ms when nothing is given; from 50ms to 30s.",
    )
    max_command_age_ms: Annotated[Duration, Within("10ms", "10s")] = Field(
        default_factory=lambda given: default_max_command_age_ms(given["loss_timeout_ms"], given["latency"]),
        description="The oldest message of the cloud that still reaches a consumer. More than the allowed "
        "loop latency + one heartbeat. Default: the allowed loop latency + lossTimeout, 150ms when nothing is given; "
        "from 10ms to 10s.",
    )
    min_dwell_ms: Annotated[Duration, Within("0s", "1h")] = Field(
        default=0,
        description="Least stay on a side before the policy moves on; safety does not wait. Default 0s, from 0s to 1h.",
    )
    mode: Literal["Auto", "Observe"] = Field(
        default="Auto",
        description="Auto switches; Observe measures, decides and says what it would do, but never switches. "
        "Default Auto.",
    )
    pin: Literal["Auto", "Robot", "Cloud"] = Field(
        default="Auto",
        description="Holds the robot's or the cloud's side whatever the policy says; safety goes first. "
        "Auto, Robot or Cloud. Default Auto.",
    )
    max_clock_offset_ms: Annotated[Duration, Within("1ms", "10s")] = Field(
        default=20,
        description="Largest difference of the two hosts' system clocks with which the cloud may act, "
        "because nodes compare time stamps. Default 20ms, from 1ms to 10s.",
    )
    activation_deadline_ms: Annotated[Duration, Within("10ms", "60s")] = Field(
        default=250,
        description="In this time the nodes of a side must become active; else the changeover is rolled "
        "back. Default 250ms, from 10ms to 60s.",
    )
    prepare_deadline_ms: Annotated[Duration, Within("10ms", "5m")] | None = Field(
        default=None,
        description="In this time a side that gets ready without a loss must have its goals and state as well. At "
        "least activationDeadline. Default 5s with actions, else activationDeadline; from 10ms to 5m.",
    )
    cancel_deadline_ms: Annotated[Duration, Within("10ms", "1m")] = Field(
        default=2_000,
        description="How long the goals of the side that acted before may take to end, before its nodes are "
        "deactivated. Default 2s, from 10ms to 1m.",
    )
    settle_for_ms: Annotated[Duration, Within("0s", "10m")] = Field(
        default=10_000,
        description="How long a side that was not ready in time stays active, so that costmaps fill. Default 10s, "
        "from 0s to 10m.",
    )
    max_message_size: Annotated[Size, UpTo("16Mi")] = Field(
        default=8 * 1024 * 1024,
        description="The largest message that is carried, e.g. 1Mi. Default 8Mi, at most 16Mi.",
    )
    silent: tuple[TopicGlob, ...] = Field(
        default=(),
        max_length=64,
        description="Topics of duplicated nodes that are not needed outside their side, so that the agents do not warn "
        "of them, e.g. [local_costmap/**]. At most 64. Default: none.",
    )
    strict: bool = Field(
        default=False,
        description="Whether the agents refuse to start when a duplicated node has publishers that are not "
        "declared as outputs; otherwise they warn. Default false.",
    )
    hold_down: HoldDown = Field(
        default_factory=HoldDown, description="How careful the return to the cloud is after a loss."
    )
