"""Which topics of duplicated nodes nobody outside their side needs."""

from __future__ import annotations

import pytest

from robot_offload_agent.settings.topics import completed, is_silent


@pytest.mark.parametrize(
    ("topic", "pattern", "silent"),
    [
        ("/local_costmap/costmap", "local_costmap/**", True),
        ("/local_costmap/a/b", "/local_costmap/**", True),
        ("/local_costmap", "local_costmap/**", True),
        ("/local_costmap_2/a", "local_costmap/**", False),
        ("/debug/a", "debug/*", True),
        ("/debug/a/b", "debug/*", False),
        ("/plan", "/plan", True),
        ("/plan/b", "/plan", False),
        ("/cmd_vel", "**", True),
    ],
)
def test_a_pattern_names_a_topic_or_what_is_below(topic: str, pattern: str, silent: bool) -> None:
    assert is_silent(topic, [pattern], "/") is silent


def test_a_relative_pattern_is_below_the_robots_namespace() -> None:
    assert is_silent("/w7/local_costmap/a", ["local_costmap/**"], "/w7")
    assert not is_silent("/local_costmap/a", ["local_costmap/**"], "/w7")


def test_a_shared_output_has_a_queue_for_all_who_publish_it() -> None:
    assert completed({"shared": True, "depth": 10})["depth"] == 100
    assert completed({"shared": True, "depth": 500})["depth"] == 500
    assert completed({"shared": False, "depth": 1})["depth"] == 1
    assert completed({"depth": 1})["depth"] == 1
