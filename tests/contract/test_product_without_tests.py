"""The product, its scripts and its examples work where there are no tests: they neither import nor start them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("core", "agent", "operator", "lab", "sim", "scripts", "examples")


def named(tree: ast.AST) -> Iterator[str]:
    """Names every module that a file imports, and every text in the file, which may name a module to start."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module or ""
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


@pytest.mark.parametrize("folder", FOLDERS)
def test_nothing_of_a_package_imports_or_starts_a_module_of_the_tests(folder: str):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    guilty = {
        f"{file.relative_to(ROOT)}: {name}"
        for file in files
        for name in named(ast.parse(file.read_text(encoding="utf-8")))
        if name == "tests" or name.startswith("tests.")
    }
    assert not guilty
