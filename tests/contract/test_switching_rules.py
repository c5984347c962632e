"""Times that cannot work together are refused by the resource and by the agent alike: the same rules on both sides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
import yaml
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import RULES
from robot_offload.errors import SpecError
from robot_offload.render.agent_config import AgentSite, agent_config
from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings import parameters as agent
from robot_offload_core.words import settings as core
from tests.unit.specs import changed

OF_THE_AGENT_ALONE = {"max_message_size", "settle_for_s"}
"""Refused by the range of the field in the resource already."""
POSITIVE = {"beat_period_s", "loss_timeout_s", "lease_s", "max_command_age_s", "robot_period_s", "cloud_period_s",
            "activation_deadline_s", "cancel_deadline_s"}  # fmt: skip
"""Must be greater than 0, which the ranges of the fields say too."""


@dataclass(frozen=True)
class Times:
    """Times in ms, all well inside every rule."""

    beat: int
    robot: int
    cloud: int
    tolerance: int

    @property
    def loss(self) -> int:
        return 4 * self.beat + self.beat // 2 + 10

    @property
    def loop(self) -> int:
        return self.robot + self.tolerance - self.cloud

    def switching(self, **changes: Any) -> dict[str, Any]:
        latency = {"robotPeriod": self.robot, "cloudPeriod": self.cloud, "tolerance": self.tolerance}
        values = {
            "heartbeatPeriod": self.beat, "lossTimeout": self.loss,
            "lease": max(50, self.loss + self.loop + 2 * self.beat + 50),
            "maxCommandAge": max(10, self.loop + self.beat + 50), "activationDeadline": 250,
        }  # fmt: skip
        latency |= {name: changes.pop(name) for name in tuple(changes) if name in latency}
        hold_down = {name: changes.pop(name) for name in tuple(changes) if name in ("initial", "max")}
        values |= changes
        return {
            **{name: f"{value}ms" for name, value in values.items()},
            "latency": {name: f"{value}ms" for name, value in latency.items()},
            **({"holdDown": {name: f"{value}ms" for name, value in hold_down.items()}} if hold_down else {}),
        }


BASES = (Times(20, 50, 20, 30), Times(25, 100, 33, 7), Times(30, 80, 10, 0), Times(999, 200, 50, 300))
NEAR = (-1, 0, 1)


def bounds(times: Times) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields, for each rule, times below, at and above its bound."""
    for by in NEAR:
        yield "loss_timeout_s", times.switching(lossTimeout=2 * times.beat + by)
        yield "tolerance_s", times.switching(robotPeriod=times.cloud + by, tolerance=0)
        yield "lease_s", times.switching(lease=times.loss + times.loop + 2 * times.beat + by)
        yield "max_command_age_s", times.switching(maxCommandAge=times.loop + times.beat + by)
        yield "hold_down_initial_s", times.switching(initial=2000 + by, max=2000)
        yield "prepare_deadline_s", times.switching(prepareDeadline=250 + by)


CASES = [(path, switching) for times in BASES for path, switching in bounds(times)]


OF_TIMES = [
    rule for rule in RULES
    if rule.path.startswith("spec.switching") and rule.reason in ("TooShort", "NeverInCloud", "OutOfRange")
]  # fmt: skip


def resource_says(switching: dict[str, Any]) -> set[str]:
    """Returns the reasons of the rules about times that the resource breaks."""
    spec = parsed(switching).spec
    return {finding.reason for rule in OF_TIMES for finding in rule.check()(spec)}


def parsed(switching: dict[str, Any]) -> RobotOffload:
    return parse_object(changed("spec.switching", switching), "f.yaml", rules=())


def agent_says(switching: dict[str, Any]) -> str:
    """Returns what the agent refuses, "" for nothing."""
    text = agent_config(parsed(switching), AgentSite("robot", "127.0.0.1", "ca.pem", "r.pem", "r.key"))
    try:
        agent.parse(agent.flatten(yaml.safe_load(text)["/**"]["ros__parameters"])).settings()
    except ConfigurationError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("path", "switching"), CASES)
def test_at_each_bound_the_resource_and_the_agent_refuse_the_same(path: str, switching: dict[str, Any]) -> None:
    refused, said = resource_says(switching), agent_says(switching)
    assert bool(refused) is bool(said), f"{path}: the resource says {refused}, the agent {said!r}"


@settings(max_examples=40, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(
    profile=st.sampled_from(["Responsive", "Balanced", "Patient"]),
    beat=st.none() | st.integers(5, 1000),
    robot=st.integers(1, 4_000),
    tolerance=st.integers(0, 4_000),
    part=st.floats(0, 0.99),
)
def test_what_is_left_out_fits_what_is_given_at_once(
    profile: str, beat: int | None, robot: int, tolerance: int, part: float
) -> None:
    """No second round of messages: heartbeat, silence, lease and age follow from whatever else stands there."""
    latency = {"robotPeriod": robot, "tolerance": tolerance, "cloudPeriod": max(1, int((robot + tolerance) * part))}
    assume(robot + tolerance - latency["cloudPeriod"] > 0 and latency["cloudPeriod"] <= 10_000)
    switching: dict[str, Any] = {"profile": profile, "latency": {name: f"{it}ms" for name, it in latency.items()}}
    if beat is not None:
        switching["heartbeatPeriod"] = f"{beat}ms"
    assert not resource_says(switching)
    assert not agent_says(switching)
    found = parsed(switching).spec.switching
    assert found.loss_timeout_ms % found.heartbeat_period_ms


def test_three_times_that_a_person_knows_are_enough() -> None:
    switching = {
        "lossTimeout": "330ms",
        "latency": {"robotPeriod": "100ms", "cloudPeriod": "20ms", "tolerance": "150ms"},
    }
    assert not resource_says(switching)
    assert not agent_says(switching)
    assert (parsed(switching).spec.switching.lease_ms, parsed(switching).spec.switching.max_command_age_ms) == (
        660,
        560,
    )


def test_a_loop_that_is_too_slow_for_any_age_is_refused_by_both() -> None:
    switching = {"latency": {"robotPeriod": "9s", "tolerance": "9s", "cloudPeriod": "1s"}}
    assert resource_says(switching) == {"TooShort"}
    assert agent_says(switching)


@pytest.mark.parametrize(
    ("profile", "times"),
    [("Responsive", (10, 45, 155, 105)), ("Balanced", (20, 90, 250, 150)), ("Patient", (50, 225, 535, 285))],
)
def test_a_profile_is_all_times_in_one_word(profile: str, times: tuple[int, ...]) -> None:
    it = parsed({"profile": profile}).spec.switching
    assert (it.heartbeat_period_ms, it.loss_timeout_ms, it.lease_ms, it.max_command_age_ms) == times


def test_a_wrong_field_is_the_only_thing_that_is_said() -> None:
    """What would follow from it is not complained of as well."""
    with pytest.raises(SpecError) as refused:
        parsed({"heartbeatPeriod": "20"})
    assert [finding.path for finding in refused.value.findings] == ["spec.switching.heartbeatPeriod"]


def test_every_rule_is_met_on_both_sides_of_its_bound() -> None:
    broken = {path for path, switching in CASES if agent_says(switching)}
    kept = {path for path, switching in CASES if not agent_says(switching)}
    between_fields = {rule.path for rule in core.RULES} - OF_THE_AGENT_ALONE - POSITIVE
    assert broken == kept == between_fields | {"loss_timeout_s", "lease_s", "max_command_age_s"}


def test_the_resource_has_no_other_rule_about_times_but_one_of_taste() -> None:
    others = {rule.reason for rule in RULES if rule.path.startswith("spec.switching") and rule not in OF_TIMES}
    assert others - {"NotYet"} == {"MultipleOfPeriod"}, "such a time works, it is an unsteady choice"
    assert len(OF_TIMES) == 6, "a new rule needs its bounds here"


@pytest.mark.parametrize(
    "field", ["heartbeatPeriod", "lossTimeout", "lease", "maxCommandAge", "activationDeadline", "cancelDeadline"]
)
def test_a_time_of_nothing_is_out_of_the_range_of_its_field(field: str) -> None:
    with pytest.raises(SpecError):
        parsed(BASES[0].switching(**{field: 0}))
