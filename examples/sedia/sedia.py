#!/usr/bin/env python3
"""Runs some of the wheelchair's nodes in one process: `python3 sedia.py lidar odometry ... --ros-args ...`.

The names are those in robotoffload.yaml. The drivers share a simulation, so they run together and `wheels_control` is
the first of them. Each name is a module and a class of this folder, imported when it is asked for.
"""

import importlib
import sys
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node

# The simulator, the law of the controller and the account of a client are those of the smaller example.
sys.path.append(str(Path(__file__).resolve().parents[1] / "wheelchair"))

NODES = {
    "wheels_control": "drivers:WheelsControl",
    "lidar": "drivers:Lidar",
    "odometry": "drivers:WheelOdometer",
    "map_server": "localising:MapServer",
    "amcl": "localising:Amcl",
    "planner_server": "servers:PlannerServer",
    "controller_server": "servers:ControllerServer",
    "behavior_server": "servers:BehaviorServer",
    "bt_navigator": "navigating:BtNavigator",
    "velocity_smoother": "wheels:VelocitySmoother",
    "collision_monitor": "wheels:CollisionMonitor",
    "waypoint_follower": "people:WaypointFollower",
    "hmi": "people:Hmi",
    "depth_camera": "drivers:DepthCamera",
    "camera": "drivers:Camera",
    "imu": "drivers:InertialUnit",
    "joystick": "drivers:Joystick",
    "battery": "drivers:Battery",
    "robot_state_publisher": "drivers:RobotStatePublisher",
    "pointcloud_to_laserscan": "perception:PointcloudToLaserscan",
    "costmap": "perception:Costmap",
    "detector": "perception:Detector",
}


def maker(name: str) -> Callable[[], Node]:
    """Return what makes the node of that name."""
    module, _, kind = NODES[name].partition(":")
    made: Callable[[], Node] = getattr(importlib.import_module(module), kind)
    return made


if __name__ == "__main__":
    given = sys.argv[1:]
    names = given[: given.index("--ros-args")] if "--ros-args" in given else given
    importlib.import_module("running").run(*(maker(name) for name in names))
