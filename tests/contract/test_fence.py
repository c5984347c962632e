"""Nothing outside the fence decides what its states become: it alone builds them and changes their fields."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FENCE = ROOT / "core" / "robot_offload_core" / "fence"
PACKAGES = ("core/robot_offload_core", "agent/robot_offload_agent")
STATES = {
    "robot_offload_core.fence.grant.Grant",
    "robot_offload_core.fence.lease.Lease",
    "robot_offload_core.fence.gate.Gate",
}
HELD = {"grant", "lease", "fence"}
"""Names of the fields that hold such a state."""


def imported(tree: ast.AST) -> dict[str, str]:
    """What each name of a module stands for."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.asname or alias.name: alias.name for alias in node.names}
    return found


def full(node: ast.expr, names: dict[str, str]) -> str:
    """The full name of what is called; "" for what has none."""
    if isinstance(node, ast.Name):
        return names.get(node.id, "")
    if isinstance(node, ast.Attribute):
        return f"{full(node.value, names)}.{node.attr}"
    return ""


def changes(source: str) -> Iterator[str]:
    """Calls that build a state of the fence, or a copy of one with other fields; assignments to a field of one."""
    tree = ast.parse(source)
    names = imported(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = full(node.func, names)
            held = node.args and isinstance(node.args[0], ast.Attribute) and node.args[0].attr in HELD
            if called in STATES or (called.endswith("replace") and held):
                yield ast.unparse(node)
        elif isinstance(node, ast.Assign | ast.AugAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                inner = target.value if isinstance(target, ast.Attribute) else None
                if isinstance(inner, ast.Attribute) and inner.attr in HELD:
                    yield ast.unparse(node)


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_outside_builds_or_changes_a_state_of_the_fence(package: str) -> None:
    files = [file for file in sorted((ROOT / package).rglob("*.py")) if FENCE not in file.parents]
    found = {str(file.relative_to(ROOT)): list(changes(file.read_text())) for file in files}
    assert {file: some for file, some in found.items() if some} == {}


def test_the_states_are_held_where_they_run() -> None:
    """A field of another name would not be looked at."""
    held = {
        "core/robot_offload_core/control/robot/placement.py": "    grant: Grant",
        "core/robot_offload_core/control/cloud/lease.py": "    lease: Lease",
        "core/robot_offload_core/collector/state.py": "    fence: ",
    }
    for file, line in held.items():
        assert line in (ROOT / file).read_text(), file


@pytest.mark.parametrize(
    "line",
    [
        "x = Grant('r', 0.0)",
        "x = grant.Grant('r', 0.0)",
        "x = replace(robot.grant, epoch=9)",
        "x = dataclasses.replace(cloud.lease, end_s=1e9)",
        "collector.fence.charge = None",
    ],
)
def test_each_way_to_go_around_it_is_found(line: str) -> None:
    head = [
        "import dataclasses",
        "from robot_offload_core.fence import grant",
        "from robot_offload_core.fence.grant import Grant",
        "from robot_offload_core.words.replace import replace",
    ]
    assert len(list(changes("\n".join([*head, line])))) == 1
