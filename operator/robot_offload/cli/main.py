"""The command `robot-offload`, also installed as the kubectl plugin `kubectl offload`."""

from __future__ import annotations

from typing import Annotated

import typer

from robot_offload.cli.app import PROGRAM, commands
from robot_offload.cli.lazy import Entry, LazyCommands


class Program(LazyCommands):
    """The first page. Commands come in the order in which a user meets them, groups of commands last."""

    entries = (
        Entry(
            "demo",
            "",
            "Run both sides on this machine while the link between them fails, and report what the consumers felt.",
        ),
        Entry("init", "init", "Write a first RobotOffload: asks five questions, or takes the answers as options."),
        Entry("import", "survey", "Look at the running ROS graph and propose a RobotOffload for it."),
        Entry("validate", "validate", "Check RobotOffload files and report every problem."),
        Entry("crd", "crd", "Print the CustomResourceDefinition of RobotOffload."),
        Entry("status", "status.command", "Show which side acts, why, the latency, and how robot and nodes are."),
        Entry(
            "console",
            "console",
            "Show all robots in the browser: which side acts and why, live and scrolled back; with RECORDING a "
            "finished run.",
        ),
        Entry("explain", "status.explain", "Show why a RobotOffload is not Ready, and the next step for each problem."),
        Entry(
            "bundle",
            "bundle.command",
            "Write the folder that a robot needs: agent configuration, certificates, environment, systemd unit, "
            "compose file.",
        ),
        Entry(
            "pair",
            "pair",
            "Write robot and workstation as two folders: certificates, agent configurations, units, compose files.",
        ),
        Entry("pin", "pin", "Hold the application on one side, or let go."),
        Entry("revoke", "revoke", "Make a robot's certificates worthless, after it was lost, sold or copied."),
        Entry("export", "export", "Write a RobotOffload and the keys of its authorities, to apply in another cluster."),
        Entry(
            "doctor",
            "doctor.command",
            "Look for what would bite, before it does: on this machine, in the cluster, and in one RobotOffload.",
        ),
        Entry(
            "simulate",
            "",
            "Try a switching policy on a recorded link: where it would have acted, and what that would have cost.",
        ),
        Entry("blackbox", "", "Replay what an agent took in and decided: its black box."),
        Entry("audit", "", "Check the audit trail of a robot: pins, switches by hand, settings, certificates."),
        Entry(
            "dockerfile",
            "images.dockerfile",
            "Print a Dockerfile for a ROS 2 node: small, cached, not root, the same for the same options.",
        ),
        Entry("build", "images.build", "Build a ROS 2 node's image with docker, podman or buildah."),
        Entry("completion", "completion", "Print a script that makes the shell complete `robot-offload`."),
        Entry("operator", "operator_process", "Run the operator until it is told to stop.", hidden=True),
        Entry(
            "render",
            "render",
            "Print what is derived from a RobotOffload: with a FILE all objects in the cluster, without asking any "
            "cluster; or one of the files below.",
        ),
        Entry("bench", "", "Measure Robot Offload on this machine, beside what one would use instead."),
    )


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
    Program,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # noqa: PLC0415 - a third of every other command's start time

        typer.echo(f"{PROGRAM} {version(PROGRAM)}")
        raise typer.Exit


@app.callback()
def program(
    *,
    show_version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Take the options that stand before a command."""
