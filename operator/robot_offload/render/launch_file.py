"""The launch file of the bundle: starts the user's own launch file with remappings by node name. Pure."""

from __future__ import annotations

from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.render.ros_names import nodes_on, remappings

LAUNCH_FILE: Final = "robot.launch.py"
_TEMPLATE: Final = '''\
"""Starts a launch file of yours, unchanged, under the names that Robot Offload needs, and the agent beside it.

    ros2 launch {folder}/{file} launch:=my_bringup/robot.launch.py
    ros2 launch {folder}/{file} launch:=/path/to/robot.launch.py agent:=false map:=/path/to/map.yaml

Each rule names its node, so it holds for that node alone: in a process of its own and composed in a container.
Further arguments reach your launch file.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, ExecuteProcess, GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import SetRemap

from launch import LaunchDescription

REMAPPINGS = {rules}
"""(node and the name that its program uses, the name that it gets)."""


def file_of(text):
    """Returns the launch file: a path, or PACKAGE/FILE with the file in the package's share folder or its launch/."""
    if Path(text).is_file():
        return text
    package, _, name = text.partition("/")
    share = Path(get_package_share_directory(package))
    for path in (share / name, share / "launch" / name):
        if path.is_file():
            return str(path)
    raise FileNotFoundError(f"launch:={{text}}: {{share}} has neither {{name}} nor launch/{{name}}")


def include(context):
    """Includes the user's launch file."""
    source = AnyLaunchDescriptionSource(file_of(LaunchConfiguration("launch").perform(context)))
    return [IncludeLaunchDescription(source)]


def generate_launch_description():
    """Returns the rules around the user's launch file, and the agent."""
    rules = [SetRemap(src=source, dst=target) for source, target in REMAPPINGS]
    agent = ExecuteProcess(
        cmd=["robot-offload-agent", "robot", "--params", {params}],
        output="screen",
        condition=IfCondition(LaunchConfiguration("agent")),
    )
    return LaunchDescription([
        DeclareLaunchArgument("launch", description="your launch file: PACKAGE/FILE or a path"),
        DeclareLaunchArgument("agent", default_value="true", description="whether the agent is started here as well"),
        agent,
        GroupAction([*rules, OpaqueFunction(function=include)]),
    ])
'''


def node_rules(offload: RobotOffload) -> tuple[tuple[str, str], ...]:
    """Return the remappings of all nodes on the robot, each bound to its node: `NODE:NAME` and the new name."""
    return tuple(
        (f"{node.name.rpartition('/')[2]}:{source}", target)
        for node in nodes_on(offload.spec, "robot")
        for source, target in remappings(offload.spec, node, "robot").items()
    )


def launch_file(offload: RobotOffload, folder: str) -> str:
    """Return the text of the launch file.

    Args:
        offload: the resource.
        folder: the bundle's future folder on the robot.
    """
    rules = "".join(f"    {rule!r},\n" for rule in node_rules(offload))
    return _TEMPLATE.format(
        folder=folder, file=LAUNCH_FILE, rules=f"[\n{rules}]" if rules else "[]", params=repr(f"{folder}/agent.yaml")
    )
