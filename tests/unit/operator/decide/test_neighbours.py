"""Which RobotOffloads get into each other's way."""

from __future__ import annotations

from typing import Any

from robot_offload.decide.neighbours import findings, matter
from tests.unit.operator.decide.worlds import offload

DISCOVERY = {"transport": {"type": "DiscoveryServer"}, "robot": {"domainID": 7}}
PEERS = {"transport": {"type": "StaticPeers", "staticPeers": {"robot": ["10.0.0.1"], "cloud": ["10.0.0.2"]}}}


def other(name: str, **spec: Any) -> dict[str, Any]:
    return {"metadata": {"name": name}, "spec": spec}


def found(spec: dict[str, Any], *others: dict[str, Any]) -> list[tuple[str, str]]:
    return [(one.reason, one.severity) for one in findings(offload(**spec), others)]


def test_two_robots_in_one_joined_domain_are_named() -> None:
    (one,) = findings(offload(**DISCOVERY), [other("runner", **DISCOVERY), other("walker", **DISCOVERY)])
    assert (one.reason, one.severity) == ("SameDomain", "warning")
    assert one.message.startswith("runner has domain 7")


def test_other_domains_namespaces_and_transports_are_no_neighbours() -> None:
    apart = other("a", transport=DISCOVERY["transport"], robot={"domainID": 8})
    named = other("b", transport=DISCOVERY["transport"], robot={"domainID": 7, "namespace": "/b"})
    zenoh = other("c", transport={"type": "Zenoh"}, robot={"domainID": 7})
    assert found(DISCOVERY, apart, named, zenoh) == []
    assert not matter(offload())


def test_one_robot_in_two_resources_is_named() -> None:
    assert found(PEERS, other("twin", **PEERS)) == [("SameRobot", "warning")]


def test_what_others_wrote_wrongly_does_not_break_the_comparison() -> None:
    broken = [other("a", transport="Zenoh"), {"metadata": {"name": "b"}}, other("c", transport={"type": "StaticPeers"})]
    assert found(DISCOVERY, *broken) == []
