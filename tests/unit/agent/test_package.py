"""The agent as a package: for pip, and for colcon on a robot, where it is an ament_python package."""

import ast
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest

AGENT = Path(__file__).resolve().parents[3] / "agent"
CORE = AGENT.parent / "core"
NAME = "robot_offload_agent"
BUILD_S = 240
LEFT_OUT = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
"""Bytecode comes and goes while other tests run."""


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    return ElementTree.parse(AGENT / "package.xml").getroot()


def test_the_manifest_is_of_an_ament_python_package_and_names_what_is_imported(manifest: ElementTree.Element) -> None:
    assert manifest.get("format") == "3"
    assert manifest.findtext("name") == NAME
    assert manifest.findtext("export/build_type") == "ament_python"
    needed = {element.text for element in manifest.findall("exec_depend")}
    imported = set()
    for path in (AGENT / NAME).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
    others = imported - set(sys.stdlib_module_names) - {NAME, "zenoh"}
    assert {name.replace("yaml", "python3-yaml") for name in others} == needed


def test_the_manifests_of_agent_and_core_tell_one_version_and_license(manifest: ElementTree.Element) -> None:
    core = ElementTree.parse(CORE / "package.xml").getroot()
    assert manifest.findtext("version") == core.findtext("version")
    assert manifest.findtext("license") == core.findtext("license") == "Apache-2.0"
    for folder, name in ((AGENT, NAME), (CORE, "robot_offload_core")):
        assert (folder / "resource" / name).is_file()


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_the_launch_file_compiles_and_starts_the_side_by_its_text_alone_as_launch_is_not_installable_here(
    side: str,
) -> None:
    path = AGENT / "launch" / f"{side}.launch.py"
    tree = ast.parse(path.read_text())
    compile(tree, str(path), "exec")
    (function,) = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert function.name == "generate_launch_description"
    calls = [n for n in ast.walk(function) if isinstance(n, ast.Call) and getattr(n.func, "id", "") == "Node"]
    (node,) = calls
    given = {keyword.arg: keyword.value for keyword in node.keywords}
    assert ast.literal_eval(given["package"]) == NAME
    assert ast.literal_eval(given["executable"]) == "robot-offload-agent"
    arguments = given["arguments"]
    assert isinstance(arguments, ast.List)
    assert [ast.literal_eval(word) for word in arguments.elts[:2]] == [side, "--params"]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, zipfile.ZipFile]:
    """Those of core and agent, built offline from a copy, with the setuptools of this environment."""
    folder = tmp_path_factory.mktemp("build")
    found = {}
    for part in ("core", "agent"):
        shutil.copytree(AGENT.parent / part, folder / part, ignore=LEFT_OUT)
        call = "from setuptools.build_meta import build_wheel; print(build_wheel('..'))"
        command = [sys.executable, "-c", call]
        done = subprocess.run(command, cwd=folder / part, capture_output=True, text=True, timeout=BUILD_S, check=False)
        assert done.returncode == 0, done.stderr
        found[part] = zipfile.ZipFile(folder / done.stdout.splitlines()[-1])
    return found


def test_each_wheel_holds_every_module_of_its_package_and_no_other(wheels: dict[str, zipfile.ZipFile]) -> None:
    for part, package, folder in (("agent", NAME, AGENT), ("core", "robot_offload_core", CORE)):
        names = set(wheels[part].namelist())
        assert {str(path.relative_to(folder)) for path in (folder / package).rglob("*.py")} <= names
        assert f"{package}/py.typed" in names
        assert {name.partition("/")[0].partition("-")[0] for name in names} == {package}


def test_the_agents_wheel_needs_the_core_of_its_version_and_brings_the_programs(
    wheels: dict[str, zipfile.ZipFile],
) -> None:
    wheel = wheels["agent"]
    names = wheel.namelist()
    points = next(name for name in names if name.endswith("entry_points.txt"))
    assert "robot-offload-agent = robot_offload_agent.main:main" in wheel.read(points).decode()
    metadata = wheel.read(next(name for name in names if name.endswith("dist-info/METADATA"))).decode()
    (version,) = re.findall("^Version: (.+)$", metadata, re.MULTILINE)
    assert f"Requires-Dist: robot-offload-core=={version}" in metadata
    assert "Requires-Python: >=3.10" in metadata
    for shared in (
        f"share/{NAME}/package.xml",
        f"share/{NAME}/launch/robot.launch.py",
        f"share/{NAME}/launch/cloud.launch.py",
        f"share/ament_index/resource_index/packages/{NAME}",
        f"lib/{NAME}/robot-offload-agent",
    ):
        assert any(name.endswith(shared) for name in names), shared


def test_programs_are_where_ros2_run_looks_and_stay_executable(wheels: dict[str, zipfile.ZipFile]) -> None:
    (info,) = [one for one in wheels["agent"].infolist() if one.filename.endswith(f"lib/{NAME}/robot-offload-agent")]
    assert info.external_attr >> 16 & 0o111


@pytest.mark.parametrize("setuptools", ["59.6.0", "68.1.2", "79.0.1"])
@pytest.mark.parametrize("folder", [CORE, AGENT])
def test_no_setuptools_of_a_supported_ubuntu_finds_what_it_cannot_read(folder: Path, setuptools: str) -> None:
    text = (folder / "pyproject.toml").read_text()
    assert "[project]" not in text, f"setuptools {setuptools} of a ROS workspace reads it wrongly or never"
    (least,) = re.findall(r"setuptools>=([\d.]+)", text)
    assert tuple(map(int, least.split("."))) <= tuple(map(int, setuptools.split(".")))
    assert not (folder / "setup.cfg").exists()
