"""Makes the agent an ament_python package as well (colcon calls this file); the metadata is in pyproject.toml.

The pure core lives in a folder of its own beside this one and is shipped with the agent, because a robot
should need one package only.
"""

from pathlib import Path

from setuptools import find_packages, setup

HERE = Path(__file__).parent
NAME = "robot_offload_agent"
CORE = "robot_offload_core"

setup(
    packages=[
        *find_packages(str(HERE), include=[NAME, f"{NAME}.*"]),
        *find_packages(str(HERE / "../core"), include=[CORE, f"{CORE}.*"]),
    ],
    package_dir={NAME: NAME, CORE: f"../core/{CORE}"},
    package_data={NAME: ["py.typed"], CORE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", [str(p.relative_to(HERE)) for p in HERE.glob("launch/*.launch.py")]),
    ],
    zip_safe=True,
)
