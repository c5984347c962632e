"""Why the API server refuses pods stands in the condition, in its own words, for every kind of workload."""

from __future__ import annotations

import pytest

from robot_offload.kube.kinds import ROBOT_OFFLOAD, STATEFUL_SET, Kind
from tests.integration.operator_cluster import Place, eventually, walker

pytestmark = pytest.mark.api

LIMIT_RANGE = Kind("v1", "LimitRange", "limitranges")
TOO_SMALL = {
    "apiVersion": "v1",
    "kind": "LimitRange",
    "metadata": {"name": "small"},
    "spec": {"limits": [{"type": "Container", "max": {"memory": "16Mi"}}]},
}


def test_a_limit_range_that_refuses_stateful_sets_and_deployments_is_quoted(place: Place) -> None:
    place.create(LIMIT_RANGE, TOO_SMALL)
    place.create(ROBOT_OFFLOAD, walker())
    place.there(STATEFUL_SET, "walker-discovery-0")
    for condition in ("DiscoveryReady", "WorkloadsAvailable"):
        message = place.wait_condition(condition, "False", "PodsRefused")["message"]
        assert "maximum memory usage per Container is 16Mi" in message
    assert place.wait_condition("Ready", "False", "PodsRefused")
    assert place.condition("Stalled")["reason"] == "PodsRefused"


def test_a_refusal_goes_when_what_refused_has_gone(place: Place) -> None:
    place.create(LIMIT_RANGE, TOO_SMALL)
    place.create(ROBOT_OFFLOAD, walker())
    place.wait_condition("DiscoveryReady", "False", "PodsRefused")
    place.delete(LIMIT_RANGE, "small")
    place.delete(STATEFUL_SET, "walker-discovery-0")  # Kubernetes itself would try again after minutes
    place.delete(STATEFUL_SET, "walker-discovery-1")
    eventually(
        lambda: place.condition("DiscoveryReady").get("reason") == "PodsNotReady",
        "pods",
        lambda: place.roff()["status"],
    )
