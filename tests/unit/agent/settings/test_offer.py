"""Settings that change at run time: what the robot takes, what it refuses and for which reason."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.settings import offer as tuning
from robot_offload_agent.settings.offer import HARD_LIMITS, RUN_TIME, Offer, judge, read_offer
from robot_offload_agent.settings.parameters import GENERAL, Configuration, parse

LOCAL = parse(
    {
        "side": "robot", "uid": "walker-1", "generation": 3, "lease_ms": 400.0, "nodes": ["walker"],
        "outputs": ["command"], "output.command.topic": "/command", "output.command.robot_topic": "/a",
        "output.command.cloud_topic": "/b", "inputs": ["odom", "map"], "input.odom.topic": "/odom",
        "input.odom.max_age_ms": 300.0, "input.map.topic": "/map",
    }
)  # fmt: skip


def judged(generation: int = 4, running: int = 3, **parameters: Any) -> tuning.Judgement:
    offer = Offer(generation, {name.replace("__", "."): value for name, value in parameters.items()})
    return judge(LOCAL, running, offer)


def taken(**parameters: Any) -> Configuration:
    judgement = judged(**parameters)
    assert judgement.configuration is not None, judgement
    assert judgement.reason == "Accepted"
    return judgement.configuration


# -- what is taken


def test_what_is_not_offered_is_as_in_the_robots_file() -> None:
    configuration = taken(pin="Robot")
    assert configuration["pin"] == "Robot"
    same = {key: value for key, value in LOCAL.values.items() if key not in ("pin", "generation")}
    assert {key: configuration[key] for key in same} == same
    assert configuration["generation"] == 4


@pytest.mark.parametrize(
    "parameters",
    [
        {"lease_ms": 300.0},
        {"loss_timeout_ms": 60},
        {"mode": "Observe"},
        {"prefer": "Robot", "min_dwell_ms": 100.0, "hold_down_initial_ms": 5.0},
        {"tolerance_ms": 20.0},
        {"input__odom__max_age_ms": 200.0, "input__map__max_rate_hz": 1.0},
        {"nodes": ["walker"], "output__command__topic": "/command", "heartbeat_period_ms": 20},
    ],
)
def test_stricter_limits_and_what_the_policy_needs_are_taken(parameters: dict[str, Any]) -> None:
    taken(**parameters)


def test_the_same_generation_may_be_offered_again_and_differently() -> None:
    assert judged(4, running=4, pin="Cloud").configuration is not None


# -- what is refused


@pytest.mark.parametrize(
    ("parameters", "reason", "named"),
    [
        ({"typo": 1}, "UnknownParameter", "typo"),
        ({"node__walker__typo": 1}, "UnknownParameter", "node.walker.typo"),
        ({"pin": "Moon"}, "Invalid", "pin"),
        ({"lease_ms": "long"}, "Invalid", "lease_ms"),
        ({"lease_ms": float("nan")}, "Invalid", "lease_ms"),
        ({"input__odom__max_age_ms": -1.0}, "Invalid", "input.odom.max_age_ms"),
        ({"heartbeat_period_ms": 40.0}, "NeedsBundle", "heartbeat_period_ms"),
        ({"nodes": ["walker", "talker"]}, "NeedsBundle", "nodes"),
        ({"uid": "walker-2"}, "NeedsBundle", "uid"),
        ({"input__scan__max_age_ms": 100.0}, "NeedsBundle", "input.scan.max_age_ms"),
        ({"input__odom__topic": "/other"}, "NeedsBundle", "input.odom.topic"),
        ({"input__odom__max_age_ms": 0.0}, "NeedsBundle", "input.odom.max_age_ms"),
        ({"input__map__max_age_ms": 100.0}, "NeedsBundle", "input.map.max_age_ms"),
        ({"input__odom__max_age_ms": 301.0}, "HardLimit", "input.odom.max_age_ms"),
        ({"lease_ms": 100.0}, "Inconsistent", "lease_ms"),
        ({"tolerance_ms": 2000.0}, "Inconsistent", "lease_ms"),
    ],
)
def test_what_is_refused_has_a_reason_and_names_the_parameter(
    parameters: dict[str, Any], reason: str, named: str
) -> None:
    judgement = judged(**parameters)
    assert (judgement.configuration, judgement.reason) == (None, reason)
    assert f"parameter {named}: " in judgement.message


@pytest.mark.parametrize("name", HARD_LIMITS)
def test_no_hard_limit_is_ever_loosened(name: str) -> None:
    judgement = judged(**{name: LOCAL[name] * 1.001})
    assert (judgement.configuration, judgement.reason) == (None, "HardLimit")
    assert "above the robot's own limit" in judgement.message


@pytest.mark.parametrize(("generation", "running"), [(2, 3), (4, 5), (2, 0)])
def test_an_older_generation_than_runs_or_was_bundled_is_refused(generation: int, running: int) -> None:
    assert judged(generation, running, pin="Robot").reason == "OlderGeneration"


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda children: st.lists(children) | st.dictionaries(st.text(), children),
    max_leaves=4,
)
names = st.sampled_from([*GENERAL, "input.odom.max_age_ms", "input.map.max_rate_hz", "input.x.topic"]) | st.text()
plausible = st.sampled_from(RUN_TIME[4:]).flatmap(lambda name: st.tuples(st.just(name), st.floats(1.0, 1000.0)))


@settings(deadline=None, max_examples=60)
@given(st.dictionaries(names, anything, max_size=4))
def test_whatever_is_offered_is_judged_with_a_reason(parameters: dict[str, Any]) -> None:
    judgement = judge(LOCAL, 3, Offer(4, parameters))
    assert judgement.reason
    assert judgement.message


@settings(deadline=None, max_examples=200)
@given(st.lists(plausible, max_size=5))
def test_whatever_is_taken_works_together_and_is_within_the_robots_limits(found: list[tuple[str, float]]) -> None:
    configuration = judge(LOCAL, 3, Offer(4, dict(found))).configuration
    if configuration is None:
        return
    configuration.settings()
    for name in HARD_LIMITS:
        assert configuration[name] <= LOCAL[name]


# -- reading


def text(**parameters: Any) -> str:
    return yaml.safe_dump({"/**": {"ros__parameters": parameters}})


def test_the_settings_file_is_a_parameter_file() -> None:
    offer = read_offer(text(generation=7, pin="Robot", input={"odom": {"max_age_ms": 100.0}}))
    assert offer == Offer(7, {"pin": "Robot", "input.odom.max_age_ms": 100.0})


def test_who_changed_the_resource_is_beside_the_parameters_and_no_part_of_what_is_offered() -> None:
    plain = read_offer(text(generation=7))
    offer = read_offer(text(generation=7) + "changed_by: kubectl-edit at 2026-11-23T12:00:00Z\n")
    assert offer == Offer(7, {}, "kubectl-edit at 2026-11-23T12:00:00Z")
    assert offer.digest == plain.digest
    assert read_offer(text(generation=7) + "changed_by: [1]\n") == plain


@pytest.mark.parametrize("damaged", ["", "{", "a: b", text(generation="new"), text(generation=-1)])
def test_what_is_no_settings_file_is_told(damaged: str) -> None:
    with pytest.raises(ConfigurationError, match="settings_file"):
        read_offer(damaged)


def test_a_digest_names_exactly_one_offer() -> None:
    first = Offer(1, {"pin": "Robot", "mode": "Auto"})
    assert first.digest == Offer(1, {"mode": "Auto", "pin": "Robot"}).digest
    others = [Offer(2, first.parameters), Offer(1, {"pin": "Cloud", "mode": "Auto"}), Offer(1, {})]
    assert len({first.digest, *(other.digest for other in others)}) == 4
