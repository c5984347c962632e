"""The test cluster by hand: a control plane, or with `up --nodes 2` a whole cluster, its nodes and robots."""

# ruff: noqa: T201 - a command line prints
from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from robot_offload_lab.cluster import by_hand, directories, ownership, processes, programs
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.definitions import definitions
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.preflight import preflight


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return 1 when it could not be done."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.cluster", description=__doc__)
    parser.add_argument(
        "--name", default="default", help="several clusters can exist side by side (default: %(default)s)"
    )
    commands = parser.add_subparsers(dest="command", required=True)
    build = commands.add_parser("build", help="build the programs, once; some ten minutes on two cores")
    build.add_argument("--nodes", action="store_true", help="also those of nodes and pods")
    start = commands.add_parser("up", help="start a control plane with our CRDs, or nodes; prints how to reach it")
    start.add_argument("--nodes", type=int, default=0, help="with so many nodes, as root (default: none)")
    start.add_argument("--number", type=int, help="0 to 9, picks names and addresses (default: the lowest free one)")
    commands.add_parser("check", help="whether this machine can run nodes, and if not, why")
    commands.add_parser("clean", help="forget the images that stay between clusters")
    commands.add_parser("down", help="end it and remove its files, also after a crash")
    commands.add_parser("status", help="what runs")
    kubectl = commands.add_parser("kubectl", help="kubectl for that cluster and no other", add_help=False)
    kubectl.add_argument("rest", nargs=argparse.REMAINDER)
    node = commands.add_parser("node", help="power and network of a node")
    node.add_argument("node", help="for example node1")
    node.add_argument("what", choices=("off", "on", "cut", "heal"))
    robot = commands.add_parser("robot", help="a machine outside the cluster")
    robot.add_argument("robot", help="its name")
    robot.add_argument("what", choices=("add", "neighbour", "run", "wire", "play", "move", "remove"))
    robot.add_argument("rest", nargs=argparse.REMAINDER, help="run COMMAND...; wire delay_ms=10 cut=both...; play FILE")
    chosen = parser.parse_args(arguments)
    try:
        return _do(chosen)
    except ClusterError as error:
        _say(str(error))
        return 1


def _do(chosen: argparse.Namespace) -> int:
    home = directories.named(chosen.name)
    match chosen.command:
        case "up":
            return _up_with_nodes(home, chosen.nodes, chosen.number) if chosen.nodes else _up(home)
        case "down":
            return _down(home)
        case "status":
            return _status(home)
        case "kubectl":
            _kubectl(home, chosen.rest)
        case "node":
            by_hand.node(by_hand.needed(home, _say), chosen.node, chosen.what)
        case "robot":
            print(by_hand.robot(by_hand.needed(home, _say), chosen.robot, chosen.what, chosen.rest))
        case _:
            return _prepare(chosen)
    return 0


def _prepare(chosen: argparse.Namespace) -> int:
    """Run a command that needs no cluster; return the exit code."""
    match chosen.command:
        case "build":
            print(programs.ensure(_say).directory)
            if chosen.nodes:
                programs.everything(_say)
        case "check":
            why = preflight()
            print(why or "This machine can run nodes.")
            return 1 if why else 0
        case "clean":
            for path in by_hand.clean():
                _say(f"removed {path}")
    return 0


def _up(home: Path) -> int:
    if processes.running(home):
        _say(f"It is running already. Next: export KUBECONFIG={home}/kubeconfig")
        return 0
    try:
        plane = ControlPlane(home, programs.ensure(_say)).start(definitions(), die_with_us=False)
    except KeyboardInterrupt:
        _say("stopped; nothing is left")
        return 130
    _tell(plane)
    return 0


def _up_with_nodes(home: Path, nodes: int, number: int | None) -> int:
    try:
        cluster = by_hand.up(home, nodes, number, _say)
    except KeyboardInterrupt:
        _say("stopped; nothing is left")
        return 130
    _tell(cluster.plane)
    return 0


def _tell(plane: ControlPlane) -> None:
    print(f"export KUBECONFIG={plane.kubeconfig}")
    print(f"export PATH={plane.programs.directory}:$PATH")


def _kubectl(home: Path, arguments: Sequence[str]) -> NoReturn:
    cluster = by_hand.find(home, _say)
    plane = cluster.plane if cluster else ControlPlane.of_directory(home, programs.ensure(_say))
    program = str(plane.programs.path("kubectl"))
    os.execve(program, [program, "--kubeconfig", str(plane.kubeconfig), *arguments], by_hand.environment())


def _down(home: Path) -> int:
    had_nodes = by_hand.down(home, _say)
    pids = processes.running(home)
    processes.kill(home)
    existed = home.exists()
    ControlPlane(home, programs.Programs(home)).stop()
    swept = directories.sweep(Path(tempfile.gettempdir()))
    if existed or not had_nodes:
        _say(f"{len(pids)} processes ended, files removed" if existed else "There was no such cluster")
    for each in swept:
        _say(f"also removed {each}, left by a test run that was killed")
    return 0


def _status(home: Path) -> int:
    pids = processes.running(home)
    for pid, name in sorted(pids.items()):
        print(f"{name:26} pid {pid}")
    with_nodes = by_hand.status()
    for line in with_nodes:
        print(line)
    layout = ownership.by_hand(home)
    if not pids and layout is None:
        _say(f"Nothing runs in {home}. Next: python -m robot_offload_lab.cluster up")
        return 1
    print(f"export KUBECONFIG={layout.plane if layout else home}/kubeconfig")
    return 0


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
