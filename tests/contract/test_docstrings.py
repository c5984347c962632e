"""What a docstring says of attributes and arguments is read line by line: each has its own."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("core", "agent", "operator", "sim", "lab", "state")
SECTION = re.compile(r"^ *(?:Attributes|Args):\n((?:^ +.*\n?)+)", re.MULTILINE)
BEGINNING = re.compile(r"[.;] ([A-Za-z_]\w*)(?:, [A-Za-z_]\w*)*: ")


def owners(tree: ast.AST) -> Iterator[tuple[ast.ClassDef | ast.FunctionDef, str]]:
    """Classes and functions with their docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            yield node, text


def names(owner: ast.AST) -> set[str]:
    """Names of attributes and arguments within a class or a function."""
    found = set()
    for node in ast.walk(owner):
        match node:
            case ast.arg(arg=name) | ast.Attribute(attr=name) | ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
    return found


def crowded(source: str) -> list[str]:
    """Names that begin in the middle of a line of a docstring."""
    found = []
    for owner, text in owners(ast.parse(source)):
        known = names(owner)
        for section in SECTION.findall(text):
            found += [name for name in BEGINNING.findall(section) if name in known]
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_each_attribute_and_argument_begins_its_own_line(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    found = {str(file.relative_to(ROOT)): crowded(file.read_text()) for file in files if ".venv" not in file.parts}
    assert {file: some for file, some in found.items() if some} == {}


def test_a_crowded_line_is_found() -> None:
    section = "        size: chunks. least_s: shortest.\n"
    source = f'class Window:\n    """Size.\n\n    Attributes:\n{section}    """\n\n    size: int\n    least_s: float\n'
    assert crowded(source) == ["least_s"]
    assert crowded(source.replace(". least_s", ".\n        least_s")) == []
