"""Rules about the times of switching."""

from __future__ import annotations

from typing import Any, Final

from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.rules.nodes import milliseconds
from robot_offload.api.v1alpha1.rules.rule import Rule

_LOOP: Final = (
    "duration(self.latency.robotPeriod) + duration(self.latency.tolerance) - duration(self.latency.cloudPeriod)"
)
_BEAT: Final = "duration(self.heartbeatPeriod)"


def _loop_ms(switching: Any) -> int:
    return max(0, int(switching.latency.allowed_loop_ms))


def _least_lease_ms(switching: Any) -> int:
    """A shorter lease would end before the robot has noticed a loss: then nobody acts."""
    return int(switching.loss_timeout_ms + _loop_ms(switching) + 2 * switching.heartbeat_period_ms)


def _floor_of_age_ms(switching: Any) -> int:
    """A smaller limit would drop every message of a link that is still good enough."""
    return int(_loop_ms(switching) + switching.heartbeat_period_ms)


RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(self.lossTimeout) > {_BEAT} + {_BEAT}",
        lambda it: it.loss_timeout_ms <= 2 * it.heartbeat_period_ms,
        "lossTimeout is not more than two heartbeat periods, so one lost beat would be an alarm; write for example "
        "90ms for a period of 20ms",
        "lossTimeout",
        lambda it: f"here {text(4 * it.heartbeat_period_ms + it.heartbeat_period_ms // 2)}",
    ),
    Rule(
        "spec.switching",
        "MultipleOfPeriod",
        f"duration(self.lossTimeout) <= {_BEAT} + {_BEAT} || "
        f"{milliseconds('self.lossTimeout')} % {milliseconds('self.heartbeatPeriod')} != 0",
        lambda it: it.loss_timeout_ms > 2 * it.heartbeat_period_ms and it.loss_timeout_ms % it.heartbeat_period_ms == 0,
        "lossTimeout is a multiple of the heartbeat period, so the last beat and the alarm would race; write for "
        "example 90ms for a period of 20ms",
        "lossTimeout",
        lambda it: f"here {text(it.loss_timeout_ms + max(1, it.heartbeat_period_ms // 2))}",
    ),
    Rule(
        "spec.switching.latency",
        "NeverInCloud",
        "duration(self.robotPeriod) + duration(self.tolerance) > duration(self.cloudPeriod)",
        lambda it: it.allowed_loop_ms <= 0,
        "robotPeriod + tolerance is not more than cloudPeriod, so no link would ever be good enough; raise tolerance "
        "or lower cloudPeriod",
        hint=lambda it: f"{text(it.robot_period_ms)} + {text(it.tolerance_ms)} and {text(it.cloud_period_ms)}",
    ),
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(self.lease) >= duration(self.lossTimeout) + ({_LOOP}) + {_BEAT} + {_BEAT}",
        lambda it: it.lease_ms < _least_lease_ms(it),
        "lease is less than lossTimeout + allowed loop latency (robotPeriod + tolerance - cloudPeriod) + two "
        "heartbeats; raise it",
        "lease",
        lambda it: f"to at least {text(_least_lease_ms(it))}",
    ),
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(self.maxCommandAge) > {_LOOP} + {_BEAT}",
        lambda it: it.max_command_age_ms <= _floor_of_age_ms(it),
        "maxCommandAge is not more than the allowed loop latency (robotPeriod + tolerance - cloudPeriod) + one "
        "heartbeat, so messages of a good link would be dropped; raise it",
        "maxCommandAge",
        lambda it: f"to more than {text(_floor_of_age_ms(it))}",
    ),
    Rule(
        "spec.switching.holdDown",
        "OutOfRange",
        "duration(self.initial) <= duration(self.max)",
        lambda it: it.initial_ms > it.max_ms,
        "initial is more than max; lower it or raise max",
        "initial",
        lambda it: f"{text(it.initial_ms)} and {text(it.max_ms)}",
    ),
)
