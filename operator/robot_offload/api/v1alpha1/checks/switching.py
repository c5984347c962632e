"""Rules about the times of switching."""

from __future__ import annotations

from collections.abc import Iterator

from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.findings import Finding


def loss_timeout_fits_heartbeat(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """One lost beat is normal, so more than two periods; at a multiple, beat and timer would race."""
    period, timeout = spec.switching.heartbeat_period_ms, spec.switching.loss_timeout_ms
    path = "spec.switching.lossTimeout"
    if timeout <= 2 * period:
        yield Finding(
            path,
            "TooShort",
            f"{text(timeout)} is not more than two heartbeat periods of {text(period)}, so one lost beat would be "
            f"an alarm; write for example {text(4 * period + period // 2)}",
        )
    elif timeout % period == 0:
        yield Finding(
            path,
            "MultipleOfPeriod",
            f"{text(timeout)} is a multiple of the heartbeat period {text(period)}, so the last beat and the "
            f"alarm would race; write for example {text(timeout + max(1, period // 2))}",
        )


def loop_latency_is_possible(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The rule loop + cloudPeriod <= robotPeriod + tolerance must leave some latency to the loop."""
    latency = spec.switching.latency
    if latency.allowed_loop_ms <= 0:
        yield Finding(
            "spec.switching.latency",
            "NeverInCloud",
            f"robotPeriod {text(latency.robot_period_ms)} + tolerance {text(latency.tolerance_ms)} is not more "
            f"than cloudPeriod {text(latency.cloud_period_ms)}, so no link would ever be good enough; raise "
            "tolerance or lower cloudPeriod",
        )


def lease_outlives_detection(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A shorter lease would end before the robot has noticed a loss: then nobody acts."""
    switching = spec.switching
    loop = max(0, switching.latency.allowed_loop_ms)
    least = switching.loss_timeout_ms + loop + 2 * switching.heartbeat_period_ms
    if switching.lease_ms < least:
        yield Finding(
            "spec.switching.lease",
            "TooShort",
            f"{text(switching.lease_ms)} is less than lossTimeout + allowed loop latency + two heartbeats "
            f"({text(switching.loss_timeout_ms)} + {text(loop)} + 2 x {text(switching.heartbeat_period_ms)}); "
            f"write at least {text(least)}",
        )


def command_age_covers_loop(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A smaller limit would drop every message of a link that is still good enough."""
    switching = spec.switching
    loop = max(0, switching.latency.allowed_loop_ms)
    floor = loop + switching.heartbeat_period_ms
    if switching.max_command_age_ms <= floor:
        yield Finding(
            "spec.switching.maxCommandAge",
            "TooShort",
            f"{text(switching.max_command_age_ms)} is not more than the allowed loop latency {text(loop)} + one "
            f"heartbeat {text(switching.heartbeat_period_ms)}, so messages of a good link would be dropped; write "
            f"more than {text(floor)}",
        )


def hold_down_grows(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The first wait is the shortest."""
    hold_down = spec.switching.hold_down
    if hold_down.initial_ms > hold_down.max_ms:
        yield Finding(
            "spec.switching.holdDown.initial",
            "OutOfRange",
            f"{text(hold_down.initial_ms)} is more than holdDown.max {text(hold_down.max_ms)}; lower it or raise max",
        )
