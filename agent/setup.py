"""Builds the agent for pip and, as an ament_python package, for colcon.

All metadata is in package.xml and here; the core's setup.py says why. The programs come twice: on PATH (`bin/`), where
the systemd unit expects them, and in the package's own folder, where `ros2 run` and `ros2 launch` look.
"""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "robot_offload_agent"
HERE = Path(__file__).parent
MANIFEST = ElementTree.parse(str(HERE / "package.xml")).getroot()  # noqa: S314 - our own file
VERSION = MANIFEST.findtext("version")


def files(pattern: str) -> "list[str]":
    """Return the files of this folder that match, relative to it."""
    return sorted(str(path.relative_to(HERE)) for path in HERE.glob(pattern) if path.is_file())


setup(
    name=NAME.replace("_", "-"),
    version=VERSION,
    description=MANIFEST.findtext("description"),
    license=MANIFEST.findtext("license"),
    author=MANIFEST.findtext("maintainer"),
    python_requires=">=3.10",
    # rclpy and the standard message packages come from the ROS installation.
    install_requires=[f"robot-offload-core=={VERSION}", "eclipse-zenoh>=1.10,<2", "pyyaml>=5.4"],
    # record: for recordings (MCAP).
    extras_require={"record": ["mcap>=1.2"]},
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", files("launch/*.launch.py")),
        (f"lib/{NAME}", files("programs/*")),
    ],
    entry_points={
        "console_scripts": [
            "robot-offload-agent = robot_offload_agent.main:main",
            "robot-offload-tunnel = robot_offload_agent.tunnel.main:main",
        ]
    },
    zip_safe=False,
)
