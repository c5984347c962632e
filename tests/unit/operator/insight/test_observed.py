"""What the command line reads out of a live object."""

from __future__ import annotations

import pytest

from robot_offload.insight.observed import ago, observe
from tests.unit.operator.cli.resources import NOW, manifest, observed


def test_a_ready_object_is_read_whole() -> None:
    found = observed()
    assert (found.namespace, found.name, found.ready, found.outdated) == ("ward", "wheelchair-7", True, False)
    assert (found.placement, found.placement_reason, found.connected) == ("Cloud", "LinkGood", True)
    assert [node.name for node in found.nodes] == ["controller", "planner"]
    assert [endpoint.address for endpoint in found.endpoints][:2] == ["203.0.113.7:7447", "203.0.113.7:7448"]


def test_without_a_status_nothing_is_known_and_nothing_fails() -> None:
    values = manifest()
    del values["status"]
    found = observe(values)
    assert (found.placement, found.connected, found.conditions, found.ready) == ("Unknown", False, (), False)
    assert found.outdated


def test_a_status_of_an_older_generation_is_no_answer() -> None:
    values = manifest()
    values["metadata"]["generation"] = 4
    assert observe(values).outdated
    assert not observe(values).ready


def test_conditions_are_in_the_order_in_which_they_become_true() -> None:
    values = manifest()
    values["status"]["conditions"].reverse()
    values["status"]["conditions"].append({"type": "FromTheFuture", "status": "True"})
    assert [each.type for each in observe(values).conditions] == [
        "SpecValid",
        "ResourcesApplied",
        "DiscoveryReady",
        "WorkloadsAvailable",
        "CertificatesReady",
        "AddressesReady",
        "Connected",
        "ConfigCurrent",
        "Ready",
        "FromTheFuture",
    ]


@pytest.mark.parametrize(
    ("since", "text"),
    [
        ("2026-11-21T10:09:15Z", "45s"),
        ("2026-11-21T09:58:00Z", "12m"),
        ("2026-11-21T07:00:00Z", "3h"),
        ("2026-11-13T10:00:00Z", "8d"),
        ("2026-11-21T12:00:00+02:00", "10m"),
        ("2027-01-01T00:00:00Z", "0s"),  # another clock is ahead
        ("", ""),
        ("yesterday", ""),
        ("2026-11-21T10:00:00", ""),
    ],
)
def test_how_long_ago_is_told_as_kubectl_does(since: str, text: str) -> None:
    assert ago(since, NOW) == text
