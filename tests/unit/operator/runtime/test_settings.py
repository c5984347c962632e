"""The operator's environment: every problem at once, nothing guessed."""

from __future__ import annotations

import pytest

from robot_offload.errors import InputError
from robot_offload.objects.facts import BUILDER
from robot_offload.runtime.settings import from_environment

NEEDED = {
    "AGENT_IMAGE": "a:1",
    "OPERATOR_IMAGE": "o:1",
    "DISCOVERY_IMAGE": "d:1",
    "ROUTER_IMAGE": "r:1",
    "POD_NAMESPACE": "here",
    "POD_NAME": "operator-0",
}


def test_what_is_needed_is_enough() -> None:
    settings = from_environment(NEEDED)
    assert (settings.watch_namespaces, settings.metrics_port, settings.images.router) == ((), 8080, "r:1")


def test_namespaces_are_a_list() -> None:
    assert from_environment({**NEEDED, "WATCH_NAMESPACE": "a,b, a"}).watch_namespaces == ("a", "b")


def test_who_builds_images_is_known_and_may_be_another() -> None:
    assert from_environment(NEEDED).images.builder == BUILDER
    assert from_environment({**NEEDED, "BUILDER_IMAGE": "mirror.example/b:1"}).images.builder == "mirror.example/b:1"


def test_networks_are_read_and_what_is_none_is_named() -> None:
    given = {
        "DNS_NETWORKS": "10.96.0.10/32, fd00::a/128",
        "METRICS_NAMESPACES": "monitoring",
        "NETWORK_POLICIES": "false",
    }
    network = from_environment({**NEEDED, **given}).network
    assert (network.dns, network.api_server, network.metrics_from) == (
        ("10.96.0.10/32", "fd00::a/128"),
        (),
        ("monitoring",),
    )
    assert not network.policies
    with pytest.raises(InputError, match="API_SERVER_NETWORKS must be networks"):
        from_environment({**NEEDED, "API_SERVER_NETWORKS": "10.0.0.1/8"})
    with pytest.raises(InputError, match="API_SERVER_SOURCES must be networks"):
        from_environment({**NEEDED, "API_SERVER_SOURCES": "192.0.2.1/24"})


def test_every_problem_is_told() -> None:
    with pytest.raises(InputError) as caught:
        from_environment(
            {
                **NEEDED,
                "AGENT_IMAGE": "",
                "WORKERS": "many",
                "LOG_LEVEL": "loud",
                "LOG_FORMAT": "x",
                "PROBE_SECONDS": "0",
            }
        )
    assert caught.value.lines == (
        "AGENT_IMAGE is not set",
        "PROBE_SECONDS must be at least 0.5, found 0",
        "LOG_LEVEL must be debug, info, warning or error, found 'loud'",
        "LOG_FORMAT must be json or text, found 'x'",
        "WORKERS must be a number, found 'many'",
    )
