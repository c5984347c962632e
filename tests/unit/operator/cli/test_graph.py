"""Who publishes what the collector alone should publish."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from robot_offload.cli.doctor.graph import Graph, ask, judge

PATIENCE_S = 60.0
PUBLISHERS = """
import sys
import rclpy
from std_msgs.msg import String
rclpy.init()
nodes = [rclpy.create_node(name) for name in ("first", "second")]
kept = [node.create_publisher(String, "/doctor/both", 1) for node in nodes]
kept.append(nodes[0].create_publisher(String, "/doctor/one", 1))
print("ready", flush=True)
sys.stdin.read()
"""


def levels(graph: Graph) -> list[str]:
    return [finding.level for finding in judge(graph)]


def test_one_publisher_or_none_is_fine_and_two_are_an_error_with_their_names() -> None:
    findings = list(judge(Graph({"/a": ["/collector"], "/b": [], "/cmd_vel": ["/teleop", "/collector"]})))
    assert [finding.level for finding in findings] == ["ok", "ok", "error"]
    assert findings[2].message == "/cmd_vel has 2 publishers: /collector, /teleop"
    assert "remappings" in findings[2].step


def test_a_node_that_publishes_twice_counts_twice() -> None:
    assert levels(Graph({"/cmd_vel": ["/driver", "/driver"]})) == ["error"]


def test_a_shell_without_ros_is_said_to_be_one() -> None:
    found = ask(["/a"], python="/bin/false")
    assert found.problem
    assert levels(found) == ["unknown"]


@pytest.mark.ros
def test_the_graph_of_this_machine_can_be_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "97")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    wanted = {"/doctor/both": ["/first", "/second"], "/doctor/one": ["/first"], "/doctor/none": []}
    with subprocess.Popen(
        [sys.executable, "-c", PUBLISHERS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as publishers:
        assert publishers.stdout is not None
        assert publishers.stdout.readline() == "ready\n"
        end_s = time.monotonic() + PATIENCE_S
        seen: dict[str, list[str]] = {}
        while seen != wanted and time.monotonic() < end_s:
            found = ask([*wanted], python=sys.executable)
            seen = {topic: sorted(nodes) for topic, nodes in found.publishers.items()}
        publishers.communicate("")
    assert found.problem == ""
    assert seen == wanted
