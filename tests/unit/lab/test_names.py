"""One word per thing: a class name is given once in the lab."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

LAB = Path(__file__).parents[3] / "lab" / "robot_offload_lab"


def test_every_class_of_the_lab_has_a_name_of_its_own() -> None:
    places = defaultdict(list)
    for file in sorted(LAB.rglob("*.py")):
        if "simulate" in file.parts:  # a world of its own, which nothing else imports
            continue
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(file.relative_to(LAB)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
