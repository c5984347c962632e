"""Runs the program that reads the graph under an interpreter that has ROS 2; this package needs none."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

from robot_offload.errors import InputError, RobotOffloadError
from robot_offload.survey.snapshot import GraphSnapshot, read

PROGRAM: Final = Path(__file__).with_name("look.py")
PATIENCE_S: Final = 120.0
"""How much longer than requested a look may take: nodes that do not answer, a slow machine."""
NEXT: Final = (
    "source the ROS 2 setup file in this shell (source /opt/ros/DISTRO/setup.bash) and run the command again; or look "
    "on the robot: `robot-offload import --program > look.py`, there `python3 look.py > graph.json`, then here "
    "`robot-offload import --from graph.json`"
)


def look(seconds: float) -> GraphSnapshot:
    """Return the ROS graph of this shell as seen within that time.

    Raises:
        InputError: no interpreter here has rclpy.
        RobotOffloadError: ROS 2 failed, or did not end.
    """
    python = interpreter()
    try:
        done = subprocess.run(
            [python, str(PROGRAM), f"{seconds:g}"],
            capture_output=True,
            text=True,
            timeout=seconds + PATIENCE_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise RobotOffloadError(
            f"ROS 2 did not answer within {seconds + PATIENCE_S:g} s; try a shorter --seconds"
        ) from None
    if done.returncode or not done.stdout:
        last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise RobotOffloadError(f"the ROS graph cannot be looked at: {last}; {NEXT}")
    return read(done.stdout, "look.py")


def interpreter() -> str:
    """Return a Python that can import rclpy: this one, or else the shell's.

    Raises:
        InputError: neither can.
    """
    if importlib.util.find_spec("rclpy") is not None:
        return sys.executable
    python = shutil.which("python3")
    command = [python or "", "-c", "import rclpy"]
    if python is None or subprocess.run(command, capture_output=True, check=False).returncode:
        raise InputError(f"import needs rclpy, which neither this Python nor the shell's python3 has: {NEXT}")
    return python
