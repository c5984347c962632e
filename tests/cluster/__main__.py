"""The test cluster by hand: build, up, down, status, kubectl."""

# ruff: noqa: T201 - a command line prints
from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.cluster import directories, processes, programs
from tests.cluster.control_plane import ControlPlane
from tests.cluster.definitions import definitions
from tests.cluster.errors import ClusterError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code is 1 when it could not be done."""
    parser = argparse.ArgumentParser(prog="python -m tests.cluster", description=__doc__)
    parser.add_argument(
        "--name", default="default", help="several clusters can exist side by side (default: %(default)s)"
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("build", help="build the programs, once; some ten minutes on two cores")
    commands.add_parser("up", help="start a control plane with our CRDs; prints how to reach it")
    commands.add_parser("down", help="end it and remove its files, also after a crash")
    commands.add_parser("status", help="what runs")
    kubectl = commands.add_parser("kubectl", help="kubectl for that cluster and no other", add_help=False)
    kubectl.add_argument("rest", nargs=argparse.REMAINDER)
    chosen = parser.parse_args(arguments)
    try:
        return _do(chosen)
    except ClusterError as error:
        _say(str(error))
        return 1


def _do(chosen: argparse.Namespace) -> int:
    home = directories.named(chosen.name)
    match chosen.command:
        case "build":
            print(programs.ensure(_say).directory)
        case "up":
            return _up(home)
        case "down":
            return _down(home)
        case "status":
            return _status(home)
        case "kubectl":
            plane = ControlPlane.of_directory(home, programs.ensure(_say))
            program = str(plane.programs.path("kubectl"))
            os.execv(program, [program, "--kubeconfig", str(plane.kubeconfig), *chosen.rest])
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
    print(f"export KUBECONFIG={plane.kubeconfig}")
    print(f"export PATH={plane.programs.directory}:$PATH")
    return 0


def _down(home: Path) -> int:
    pids = processes.running(home)
    processes.kill(home)
    existed = home.exists()
    ControlPlane(home, programs.Programs(home)).stop()
    swept = directories.sweep(Path(tempfile.gettempdir()))
    _say(f"{len(pids)} processes ended, files removed" if existed else "There was no such cluster")
    for each in swept:
        _say(f"also removed {each}, left by a test run that was killed")
    return 0


def _status(home: Path) -> int:
    pids = processes.running(home)
    for pid, name in sorted(pids.items()):
        print(f"{name:26} pid {pid}")
    if not pids:
        _say(f"Nothing runs in {home}. Next: python -m tests.cluster up")
        return 1
    print(f"export KUBECONFIG={home}/kubeconfig")
    return 0


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
