"""Which nodes can leave the robot, and why the others cannot: by their devices, their topics, their names.

A node is bound to the robot if it has a device open, publishes what sensors publish and hears nothing, or takes the
commands that move the robot and passes none on. The names are conventions of ROS 2 robots (Nav2, ros2_control), from
docs/how-to/which-nodes.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from robot_offload.api.v1alpha1.name_rules import OWN_NODES, OWN_TOPIC_PREFIX, REMOTE_PREFIX
from robot_offload.survey.owners import Owners
from robot_offload.survey.snapshot import GraphSnapshot, NodeSeen

COMMANDS: Final = frozenset({
    "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped", "ackermann_msgs/msg/AckermannDrive",
    "ackermann_msgs/msg/AckermannDriveStamped", "trajectory_msgs/msg/JointTrajectory",
})  # fmt: skip
"""Types of messages that move a robot."""
SENSED: Final = frozenset({"nav_msgs/msg/Odometry"} | {f"sensor_msgs/msg/{name}" for name in (
    "LaserScan", "Image", "CompressedImage", "PointCloud2", "Imu", "NavSatFix", "JointState", "BatteryState", "Range",
    "Joy", "MagneticField", "FluidPressure", "Temperature", "RelativeHumidity", "MultiEchoLaserScan", "CameraInfo",
)})  # fmt: skip
"""Types of messages from devices: odometry comes from wheels, unless its node hears what it fuses."""
PLUMBING: Final = ("/rosout", "/parameter_events", "/clock", "/tf", "/tf_static", "/diagnostics", "/bond")
"""Topics that reveal nothing about a node's function."""
HABITS: Final = (
    (r"velocity_smoother", "smooths the commands behind the collector, and would jerk if it began anew"),
    (r"collision_monitor", "is the last before the wheels; a link must not stand between them"),
    (r"twist_mux|cmd_vel_mux", "chooses among commands behind the collector"),
    (r"controller_manager|.*ros2_control.*", "runs in step with the hardware"),
    (r"(robot|joint)_state_publisher", "publishes what every node of the robot needs; costs nearly nothing"),
    (r"map_server", "keeps the map; the cloud gets it as a latched input"),
    (r"lifecycle_manager.*", "brings nodes up; the guardian does that for duplicated ones"),
    (r".*container(_mt|_isolated)?", "only holds components"),
    (r"rviz.*|rqt.*|foxglove.*|rosbridge.*|rosbag2.*|.*_recorder|teleop.*", "is a person's tool"),
)
"""Names of nodes, as patterns, and why they stay."""


class Kind(Enum):
    """The possible placements of a node."""

    OURS = "ours"
    BOUND = "bound"
    FREE = "free"


@dataclass(frozen=True, slots=True)
class Role:
    """A node's possible placement, and why."""

    kind: Kind
    reason: str = ""


def roles(graph: GraphSnapshot, owned: Owners) -> Mapping[str, Role]:
    """Return the role of every node of a graph, by full name."""
    heard: dict[str, set[tuple[str, str]]] = {node.name: set() for node in graph.nodes}
    said: dict[str, set[tuple[str, str]]] = {node.name: set() for node in graph.nodes}
    for topic in graph.topics:
        for ends, of in ((topic.publishers, said), (topic.subscribers, heard)):
            for end in ends:
                of.setdefault(end.node, set()).update((topic.name, each) for each in topic.types)
    return {node.name: _role(node, owned, said[node.name], heard[node.name]) for node in graph.nodes}


def _role(node: NodeSeen, owned: Owners, said: set[tuple[str, str]], heard: set[tuple[str, str]]) -> Role:
    last = node.name.rpartition("/")[2]
    if last.startswith("_"):
        return Role(Kind.OURS, "is hidden")
    if last in OWN_NODES or last.startswith(REMOTE_PREFIX):
        return Role(Kind.OURS, "belongs to the agents of Robot Offload")
    process = owned.process.get(node.name)
    if process is not None and process.devices:
        return Role(Kind.BOUND, f"has {', '.join(process.devices[:3])} open")
    for pattern, reason in HABITS:
        if re.fullmatch(pattern, last):
            return Role(Kind.BOUND, reason)
    taken = sorted(name for name, kind in heard if kind in COMMANDS and not name.startswith(OWN_TOPIC_PREFIX))
    if taken and not any(kind in COMMANDS for _, kind in said):
        return Role(Kind.BOUND, f"takes the commands of {taken[0]} and passes none on: it moves the robot")
    sensed = sorted(name for name, kind in said if kind in SENSED)
    if sensed and all(name in PLUMBING for name, _ in heard):
        return Role(Kind.BOUND, f"publishes {sensed[0]} and hears nothing: it is a sensor's driver")
    return Role(Kind.FREE)
