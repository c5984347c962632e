"""The command `robot-offload`, also installed as the kubectl plugin `kubectl offload`."""

from __future__ import annotations

from robot_offload.cli import completion, crd, lab, operator_process, pin, render, revoke, validate
from robot_offload.cli.app import commands
from robot_offload.cli.bundle import command as bundle
from robot_offload.cli.doctor import command as doctor
from robot_offload.cli.images import build, dockerfile
from robot_offload.cli.status import command as status
from robot_offload.cli.status import explain

app = commands(
    "Runs replicas of a robot's ROS 2 nodes in a cluster and switches between the two sides. The same as a kubectl "
    "plugin: kubectl offload.",
    [
        "robot-offload demo",
        "robot-offload validate wheelchair.yaml",
        "robot-offload render wheelchair.yaml",
        "kubectl offload status",
        "kubectl offload explain wheelchair",
        "kubectl offload bundle wheelchair -o wheelchair",
    ],
)

# One line for each command, in the order in which one meets them.
lab.add_to(app, "demo")
validate.add_to(app)
render.add_to(app)
crd.add_to(app)
status.add_to(app)
explain.add_to(app)
bundle.add_to(app)
pin.add_to(app)
revoke.add_to(app)
doctor.add_to(app)
lab.add_to(app, "simulate")
lab.add_to(app, "bench")
dockerfile.add_to(app)
build.add_to(app)
completion.add_to(app)
operator_process.add_to(app)
