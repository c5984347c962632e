"""Rules about the times of switching."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from robot_offload.api.v1alpha1.quantities import format_duration as text
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.nodes import milliseconds
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.api.v1alpha1.switching import HEARTBEATS_MS, LARGEST_AGE_MS, LONGEST_LEASE_MS
from robot_offload.findings import Finding

_LOOP: Final = (
    "duration(self.latency.robotPeriod) + duration(self.latency.tolerance) - duration(self.latency.cloudPeriod)"
)
_BEAT: Final = (
    "duration(has(self.heartbeatPeriod) ? self.heartbeatPeriod : "
    + "".join(f"self.profile == '{word}' ? '{ms}ms' : " for word, ms in HEARTBEATS_MS.items() if word != "Balanced")
    + f"'{HEARTBEATS_MS['Balanced']}ms')"
)
_BEAT_MS: Final = f"({_BEAT}.getSeconds() * 1000 + {_BEAT}.getMilliseconds() % 1000)"
_LOOP_MS: Final = (
    f"{milliseconds('self.latency.robotPeriod')} + {milliseconds('self.latency.tolerance')} - "
    f"{milliseconds('self.latency.cloudPeriod')}"
)
_LOSS_MS: Final = f"(has(self.lossTimeout) ? {milliseconds('self.lossTimeout')} : {_BEAT_MS} * 9 / 2)"
_LEASE_MS: Final = f"(has(self.lease) ? {milliseconds('self.lease')} : {LONGEST_LEASE_MS})"
"""What is not given, as `api.v1alpha1.switching` works it out. Numbers: the cost of texts has no bound in CEL."""


LONG_LOSS_MS: Final = 1_000
"""In more time a vehicle at walking pace goes further than a metre before its commands come from the robot again."""


def losses_are_noticed_soon(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Warn of a long time without commands: of outputs with a rate somebody waits for each message."""
    loss_ms = spec.switching.loss_timeout_ms
    if loss_ms <= LONG_LOSS_MS:
        return
    rated = [output.topic for node, output in spec.collected_outputs if node.duplicated and output.rate_hz]
    if rated:
        yield Finding(
            "spec.switching.lossTimeout",
            "LongSilence",
            f"nobody publishes {', '.join(map(repr, rated[:3]))} for {text(int(loss_ms))} when the link breaks; "
            "what listens needs a shorter time-out of its own, or write a lossTimeout of at most 1s",
            "warning",
        )


def _loop_ms(switching: Any) -> int:
    return max(0, int(switching.latency.allowed_loop_ms))


def _least_lease_ms(switching: Any) -> int:
    """Return a shorter lease would end before the robot has noticed a loss: then nobody acts."""
    return int(switching.loss_timeout_ms + _loop_ms(switching) + 2 * switching.heartbeat_period_ms)


def _floor_of_age_ms(switching: Any) -> int:
    """Return a smaller limit would drop every message of a link that is still good enough."""
    return int(_loop_ms(switching) + switching.heartbeat_period_ms)


RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "spec.switching",
        "TooShort",
        f"!has(self.lossTimeout) || duration(self.lossTimeout) > {_BEAT} + {_BEAT}",
        lambda it: it.loss_timeout_ms <= 2 * it.heartbeat_period_ms,
        "lossTimeout is not more than two heartbeat periods, so one lost beat would be an alarm; write for example "
        "90ms for a period of 20ms",
        "lossTimeout",
        lambda it: f"here {text(4 * it.heartbeat_period_ms + it.heartbeat_period_ms // 2)}",
    ),
    Rule(
        "spec.switching",
        "MultipleOfPeriod",
        f"!has(self.lossTimeout) || duration(self.lossTimeout) <= {_BEAT} + {_BEAT} || "
        f"{milliseconds('self.lossTimeout')} % {_BEAT_MS} != 0",
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
        f"{_LEASE_MS} >= {_LOSS_MS} + {_LOOP_MS} + 2 * {_BEAT_MS}",
        lambda it: it.lease_ms < _least_lease_ms(it),
        "lease is less than lossTimeout + allowed loop latency (robotPeriod + tolerance - cloudPeriod) + two "
        "heartbeats; raise it, or leave it out",
        "lease",
        lambda it: f"to at least {text(_least_lease_ms(it))}",
    ),
    Rule(
        "spec.switching",
        "TooShort",
        f"duration(has(self.maxCommandAge) ? self.maxCommandAge : '{text(LARGEST_AGE_MS)}') > {_LOOP} + {_BEAT}",
        lambda it: it.max_command_age_ms <= _floor_of_age_ms(it),
        "maxCommandAge is not more than the allowed loop latency (robotPeriod + tolerance - cloudPeriod) + one "
        "heartbeat, so messages of a good link would be dropped; raise it, or leave it out",
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
