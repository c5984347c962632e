"""The command `robot-offload`, also installed as the kubectl plugin `kubectl offload`."""

from __future__ import annotations

from robot_offload.cli import (
    bench,
    build,
    bundle,
    completion,
    crd,
    demo,
    dockerfile,
    doctor,
    explain,
    operator_process,
    pin,
    render,
    revoke,
    simulate,
    status,
    validate,
)
from robot_offload.cli.app import commands

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
demo.add_to(app)
validate.add_to(app)
render.add_to(app)
crd.add_to(app)
status.add_to(app)
explain.add_to(app)
bundle.add_to(app)
pin.add_to(app)
revoke.add_to(app)
doctor.add_to(app)
simulate.add_to(app)
bench.add_to(app)
dockerfile.add_to(app)
build.add_to(app)
completion.add_to(app)
operator_process.add_to(app)
