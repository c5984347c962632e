"""The tests import what is there: a renamed name must not wait for `make e2e` to be found."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

TESTS = Path(__file__).parents[1]


def test_every_name_that_a_test_imports_from_the_product_is_there() -> None:
    missing = []
    for file in sorted(TESTS.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("robot_offload"):
                continue
            module = importlib.import_module(node.module or "")
            for alias in node.names:
                if not hasattr(module, alias.name):
                    try:
                        importlib.import_module(f"{module.__name__}.{alias.name}")
                    except ImportError:
                        missing.append(f"{file.relative_to(TESTS)}: {module.__name__}.{alias.name}")
    assert missing == []
