"""The launch file of the bundle, by its text and under stand-ins: launch and launch_ros are not to be had as wheels."""

import ast
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from robot_offload.api.files import load
from robot_offload.render.launch_file import launch_file, node_rules

ROOT = Path(__file__).resolve().parents[4]
FOLDER = "/etc/robot-offload/wheelchair"
MODULES = {
    "ament_index_python.packages": ["get_package_share_directory"],
    "launch": ["LaunchDescription"],
    "launch.actions": [
        "DeclareLaunchArgument", "ExecuteProcess", "GroupAction", "IncludeLaunchDescription", "OpaqueFunction",
    ],
    "launch.conditions": ["IfCondition"],
    "launch.launch_description_sources": ["AnyLaunchDescriptionSource"],
    "launch.substitutions": ["LaunchConfiguration"],
    "launch_ros.actions": ["SetRemap"],
}  # fmt: skip


class Action:
    """Keeps what it was made of."""

    def __init__(self, *parts: Any, **named: Any) -> None:
        self.parts, self.named = parts, named

    def perform(self, context: dict[str, str]) -> str:
        return context[self.parts[0]]


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Any]:
    """The launch file's own names, with a class of its own for each action."""
    for name, members in MODULES.items():
        module = types.ModuleType(name)
        for member in members:
            setattr(module, member, type(member, (Action,), {}))
        monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setitem(sys.modules, name.partition(".")[0], sys.modules.get(name.partition(".")[0], module))
    share: Any = sys.modules["ament_index_python.packages"]
    share.get_package_share_directory = lambda package: str(tmp_path / package)
    names: dict[str, Any] = {}
    exec(
        compile(launch_file(load(ROOT / "manifests/samples/wheelchair.yaml"), FOLDER), "robot.launch.py", "exec"), names
    )
    return names


def test_the_rules_surround_the_users_launch_file_and_stand_before_it(loaded: dict[str, Any]) -> None:
    (actions,) = loaded["generate_launch_description"]().parts
    (group,) = [action for action in actions if type(action).__name__ == "GroupAction"]
    kinds = [type(action).__name__ for action in group.parts[0]]
    assert kinds == ["SetRemap", "OpaqueFunction"]
    assert group.parts[0][0].named == {"src": "controller:/cmd_vel", "dst": "/offload/robot/cmd_vel"}
    (agent,) = [action for action in actions if type(action).__name__ == "ExecuteProcess"]
    assert agent.named["cmd"] == ["robot-offload-agent", "robot", "--params", f"{FOLDER}/agent.yaml"]


def test_the_users_file_is_a_path_or_in_a_package(loaded: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "bringup" / "launch" / "robot.launch.py"
    path.parent.mkdir(parents=True)
    path.touch()
    assert loaded["file_of"](str(path)) == loaded["file_of"]("bringup/robot.launch.py") == str(path)
    with pytest.raises(FileNotFoundError, match=r"neither other\.launch\.py nor"):
        loaded["file_of"]("bringup/other.launch.py")


@pytest.mark.parametrize("path", sorted((ROOT / "manifests/samples").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_sample_has_a_launch_file_that_python_reads_back_with_its_rules(path: Path) -> None:
    offload = load(path)
    tree = ast.parse(launch_file(offload, "/etc/with 'quotes'"))
    (rules,) = [
        ast.literal_eval(each.value)
        for each in tree.body
        if isinstance(each, ast.Assign) and getattr(each.targets[0], "id", "") == "REMAPPINGS"
    ]
    assert tuple(rules) == node_rules(offload)
    assert all(":" in source for source, _ in rules)
