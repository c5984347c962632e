"""Why the robot acts although a cloud is there, in the order in which one would ask."""

from __future__ import annotations

from typing import Any

from robot_offload.insight.observed import Observed, observe
from robot_offload.insight.staying import Stay, staying

WAITING = Stay(
    site="robot", reason="HoldDown", message="The link is back, hold-down for another 3.2 s", connected=True,
    latency_ms=75.0, allowed_ms=60.0, loss_timeout_ms=90.0, hold_down_s=(1.0, 30.0),
)  # fmt: skip


def offload(**switching: Any) -> Observed:
    return observe({"metadata": {"name": "w"}, "spec": {"switching": switching}})


def test_the_rules_own_sentence_comes_with_its_numbers() -> None:
    said = " ".join(staying(WAITING, None))
    assert "HoldDown: The link is back, hold-down for another 3.2 s" in said
    assert "Loop latency 75 ms, 15 ms over the bound of 60 ms" in said
    assert "Silence of 90 ms counts as a loss" in said
    assert "1 s, doubled each time up to 30 s" in said


def test_what_a_person_wanted_comes_before_the_rule() -> None:
    first = next(iter(staying(WAITING, offload(pin="Robot"))))
    assert first == "It is pinned to the robot; let the rule decide to end that."
    assert "never switches" in next(iter(staying(WAITING, offload(mode="Observe"))))
    assert "prefer is Robot" in next(iter(staying(WAITING, offload(prefer="Robot"))))


def test_when_the_cloud_acts_nothing_has_to_be_explained() -> None:
    assert list(staying(Stay("cloud", "", "", True), None)) == ["The cloud acts."]


def test_a_robot_that_is_not_heard_is_said_so() -> None:
    said = list(staying(Stay("unknown", "", "", False), offload()))
    assert said == ["No agent of the robot is heard, so no handover is possible."]
