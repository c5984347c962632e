"""Messages of 16 MB, both ways, beside commands that must not suffer from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from std_msgs.msg import Header

from tests.ros.agent.harness import World

LARGE_BYTES = 16_000_000
LARGE_PATIENCE_S = 60.0
FEW = 10
"""So many are kept: each is large."""
LARGE: dict[str, Any] = {
    "max_message_size": 16 << 20,
    "outputs": ["command", "points"],
    "output.points.topic": "/points",
    "output.points.type": "std_msgs/msg/Header",
    "output.points.robot_topic": "/offload/robot/points",
    "output.points.cloud_topic": "/mapper/command",
    "output.points.node": "mapper",
    "output.points.of_cloud": True,
    "output.points.max_age_ms": 20_000.0,
    "inputs": ["odom", "map", "scans"],
    "input.scans.topic": "/scans",
    "input.scans.type": "std_msgs/msg/Header",
}


def test_sixteen_megabytes_pass_in_both_directions_while_commands_go_on(build: Callable[..., World]) -> None:
    world = build(both=LARGE, cloud={"nodes": ["walker", "mapper"], "node.mapper.duplicated": False})
    points = world.ear.hear(Header, "/points", FEW)
    scans = world.cloud_ear().hear(Header, "/scans", FEW)
    world.start_node("cloud", other="mapper", padding=LARGE_BYTES, rate_hz=0.5)
    world.start()
    scan = Header(frame_id="." * LARGE_BYTES)
    publisher = world.ear.node.create_publisher(Header, "/scans", 1)
    world.ear.node.create_timer(1.5, lambda: publisher.publish(scan))
    for heard, what in ((points, "points at the robot"), (scans, "scans in the cloud")):
        world.until(lambda h=heard: len(h) >= 3, what, LARGE_PATIENCE_S)
        assert all(len(message.frame_id) >= LARGE_BYTES for _, message in list(heard))
    since = len(world.arrivals)
    world.until(lambda: len(world.arrivals) - since > 20, "commands beside them")
    world.check()
