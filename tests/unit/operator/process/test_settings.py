"""The operator's environment: every problem at once, nothing guessed."""

from __future__ import annotations

import pytest

from robot_offload.errors import InputError
from robot_offload.objects.facts import BUILDER
from robot_offload.process.settings import from_environment

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
