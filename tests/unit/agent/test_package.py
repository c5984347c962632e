"""The agent as a package: for pip, and for colcon on a robot, where it is an ament_python package."""

import ast
import configparser
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest
import tomllib

AGENT = Path(__file__).resolve().parents[3] / "agent"
NAME = "robot_offload_agent"
BUILD_S = 120


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    return ElementTree.parse(AGENT / "package.xml").getroot()


@pytest.fixture(scope="module")
def project() -> dict[str, object]:
    found: dict[str, object] = tomllib.loads((AGENT / "pyproject.toml").read_text())["project"]
    return found


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
    others = imported - set(sys.stdlib_module_names) - {NAME, "robot_offload_core", "zenoh"}
    assert {name.replace("yaml", "python3-yaml") for name in others} == needed


def test_both_manifests_tell_one_version_and_one_license(
    manifest: ElementTree.Element, project: dict[str, object]
) -> None:
    assert manifest.findtext("version") == project["version"]
    assert manifest.findtext("license") == project["license"]
    assert f"{NAME}/".startswith(NAME)
    assert str(project["name"]).replace("-", "_") == NAME


def test_colcon_finds_the_marker_and_installs_programs_where_ros_looks_for_them() -> None:
    assert (AGENT / "resource" / NAME).is_file()
    config = configparser.ConfigParser()
    config.read(AGENT / "setup.cfg")
    assert config["install"]["install_scripts"] == f"$base/lib/{NAME}"
    assert config["develop"]["script_dir"] == f"$base/lib/{NAME}"


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
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """Built offline from a copy, with the setuptools of this environment."""
    folder = tmp_path_factory.mktemp("build")
    for part in ("agent", "core"):
        shutil.copytree(AGENT.parent / part, folder / part, ignore=shutil.ignore_patterns("build", "*.egg-info"))
    call = "from setuptools.build_meta import build_wheel; build_wheel('out')"
    (folder / "agent" / "out").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", call], cwd=folder / "agent", capture_output=True, text=True, timeout=BUILD_S, check=False
    )
    assert done.returncode == 0, done.stderr
    (path,) = (folder / "agent" / "out").glob("*.whl")
    return zipfile.ZipFile(path)


def test_the_wheel_holds_every_module_of_agent_and_core_and_nothing_of_the_operator(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    for package, folder in ((NAME, AGENT), ("robot_offload_core", AGENT.parent / "core")):
        for path in (folder / package).rglob("*.py"):
            assert str(path.relative_to(folder)) in names
        assert f"{package}/py.typed" in names
    assert not any(name.startswith(("robot_offload/", "tests/")) for name in names)


def test_the_wheel_brings_the_command_and_what_ros_needs(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    points = next(name for name in names if name.endswith("entry_points.txt"))
    assert "robot-offload-agent = robot_offload_agent.main:main" in wheel.read(points).decode()
    for shared in (
        f"share/{NAME}/package.xml",
        f"share/{NAME}/launch/robot.launch.py",
        f"share/{NAME}/launch/cloud.launch.py",
        f"share/ament_index/resource_index/packages/{NAME}",
    ):
        assert any(name.endswith(shared) for name in names), shared
