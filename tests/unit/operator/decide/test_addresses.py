"""Whether a robot can be told where the cloud listens."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.decide.addresses import addresses_ready
from robot_offload.objects.facts import Endpoint
from tests.unit.specs import sample


def offload(**spec: Any) -> RobotOffload:
    values = sample()
    values["spec"] |= spec
    return parse_object(values, "w.yaml")


@pytest.mark.parametrize(
    ("expose", "next_step"),
    [("LoadBalancer", "type NodePort does without"), ("NodePort", "expose.host"), ("ClusterIP", "no addresses")],
)
def test_without_an_address_the_message_says_what_gives_one(expose: str, next_step: str) -> None:
    verdict = addresses_ready(offload(transport={"type": "Zenoh", "expose": {"type": expose}}), ())
    assert (verdict.truth, verdict.reason) == ("False", "AddressPending")
    assert "pulse, data" in verdict.message
    assert next_step in verdict.message


def test_one_address_of_several_is_not_enough() -> None:
    one = Endpoint("pulse", "UDP", "203.0.113.7", 7447)
    verdict = addresses_ready(offload(transport={"type": "Zenoh"}), (one,))
    assert (verdict.truth, verdict.reason) == ("False", "AddressPending")
    assert "pulse," not in verdict.message


def test_with_all_addresses_the_message_names_them() -> None:
    wanted = offload(transport={"type": "Zenoh"})
    points = [Endpoint(purpose, "UDP", "203.0.113.7", 7447) for purpose in transport.of(wanted.spec).purposes(wanted)]
    verdict = addresses_ready(wanted, points)
    assert (verdict.truth, verdict.reason) == ("True", "Known")
    assert "203.0.113.7:7447" in verdict.message


def test_a_transport_without_addresses_needs_none() -> None:
    peers = {"type": "StaticPeers", "staticPeers": {"robot": ["10.0.0.1"], "cloud": ["10.0.0.2"]}}
    assert addresses_ready(offload(transport=peers, cloud={}), ()).reason == "NotNeeded"


def test_an_address_on_which_nothing_listens_is_named() -> None:
    wanted = offload(transport={"type": "Zenoh"})
    points = [Endpoint(purpose, "UDP", "2001:db8::7", 7447) for purpose in transport.of(wanted.spec).purposes(wanted)]
    verdict = addresses_ready(wanted, points)
    assert (verdict.truth, verdict.reason) == ("False", "AddressFamily")
    assert "[2001:db8::7]:7447" in verdict.message


def test_of_both_families_the_one_that_is_heard_is_taken() -> None:
    wanted = offload(transport={"type": "Zenoh", "expose": {"type": "LoadBalancer"}})
    ports = {"wheelchair-7-udp": ("pulse", "data"), "wheelchair-7-tcp": ("pulse-fallback", "data-fallback")}
    ingress = [{"ip": "2001:db8::7"}, {"ip": "203.0.113.7"}]
    services = [
        {
            "metadata": {"name": name},
            "spec": {"type": "LoadBalancer", "ports": [{"name": port, "port": 7447} for port in names]},
            "status": {"loadBalancer": {"ingress": ingress}},
        }
        for name, names in ports.items()
    ]
    found = transport.observed_endpoints(wanted, services, ())
    assert {point.host for point in found} == {"203.0.113.7"}
