"""The command `robot-offload`, also installed as the kubectl plugin `kubectl offload`."""

from __future__ import annotations

from robot_offload.cli import demo, render, simulate, validate
from robot_offload.cli.app import commands

app = commands(
    "Runs replicas of a robot's ROS 2 nodes in a cluster and switches between the two sides.",
    [
        "robot-offload demo",
        "robot-offload validate wheelchair.yaml",
        "robot-offload render agent-config wheelchair.yaml --side robot",
    ],
)

# One line for each command.
demo.add_to(app)
validate.add_to(app)
render.add_to(app)
simulate.add_to(app)
