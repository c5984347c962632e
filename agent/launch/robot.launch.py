"""Starts the robot's agent: `ros2 launch robot_offload_agent robot.launch.py params:=/path/robot.yaml`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the arguments: the parameter file of the bundle is the only one."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", description="parameter file of the bundle, robot.yaml"),
            Node(
                package="robot_offload_agent",
                executable="robot-offload-agent",
                arguments=["robot", "--params", LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
