"""Builds the core for pip and, as an ament_python package, for colcon.

All metadata is in package.xml and here: the setuptools of Ubuntu 22.04 (59.6) reads no `[project]` table, that of
24.04 (68.1) no license expression in it, and colcon cannot read what newer ones make of `requires-python`.
"""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "robot_offload_core"
MANIFEST = ElementTree.parse(str(Path(__file__).parent / "package.xml")).getroot()  # noqa: S314 - our own file

setup(
    name=NAME.replace("_", "-"),
    version=MANIFEST.findtext("version"),
    description=MANIFEST.findtext("description"),
    license=MANIFEST.findtext("license"),
    author=MANIFEST.findtext("maintainer"),
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    zip_safe=False,
)
