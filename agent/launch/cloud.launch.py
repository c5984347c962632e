"""Starts the agent of the cloud's side: `ros2 launch robot_offload_agent cloud.launch.py params:=/path/cloud.yaml`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the arguments: the parameter file of the bundle is the only one."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", description="parameter file of the bundle, cloud.yaml"),
            Node(
                package="robot_offload_agent",
                executable="robot-offload-agent",
                arguments=["cloud", "--params", LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
