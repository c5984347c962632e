"""Which objects may act although nobody has judged them, and which may not."""

from __future__ import annotations

import datetime
from typing import Any

import pytest

from robot_offload.decide.admission import ADMITTED, InForce, finding, in_force
from tests.unit.operator.decide.worlds import offload

SINCE = datetime.datetime(2026, 11, 25, 12, 0, 0, tzinfo=datetime.UTC)
POLICY = InForce("p-1", SINCE)
ASKING = {"cloud": {"imagePullSecrets": [{"name": "login"}]}}


def raw(made: str, **annotations: str) -> dict[str, Any]:
    return {"metadata": {"name": "walker", "namespace": "ward", "creationTimestamp": made, "annotations": annotations}}


def judged(made: str, spec: dict[str, Any], policy: InForce | None = POLICY, **annotations: str) -> str:
    found = finding(raw(made, **annotations), offload(**spec), "the-policy", policy)
    return "" if found is None else found.message


def test_what_is_younger_than_the_policy_acts() -> None:
    assert judged("2026-11-25T12:00:10Z", ASKING) == ""


@pytest.mark.parametrize("made", ["2026-11-25T11:00:00Z", "2026-11-25T12:00:01Z"])
def test_what_is_older_or_hardly_younger_needs_somebody_who_vouches_for_it(made: str) -> None:
    assert f"annotate roff walker -n ward --overwrite {ADMITTED}=p-1" in judged(made, ASKING)


def test_the_word_for_another_policy_vouches_for_nothing() -> None:
    assert judged("2026-11-25T11:00:00Z", ASKING, **{ADMITTED: "p-0"})
    assert judged("2026-11-25T11:00:00Z", ASKING, **{ADMITTED: "p-1"}) == ""


def test_without_a_policy_nothing_acts_that_asks_for_more() -> None:
    assert "the-policy" in judged("2026-11-25T13:00:00Z", ASKING, None)
    assert judged("2026-11-25T11:00:00Z", {}, None) == ""


def test_a_policy_counts_from_when_its_binding_was_there_too() -> None:
    policy = {"metadata": {"uid": "p-1", "creationTimestamp": "2026-11-25T11:00:00Z"}}
    binding = {"metadata": {"uid": "b-1", "creationTimestamp": "2026-11-25T12:00:00Z"}}
    assert in_force(policy, binding) == POLICY
    assert in_force(policy, None) is None
    assert in_force(None, binding) is None
