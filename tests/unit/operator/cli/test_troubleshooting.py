"""Every reason that the operator can give has its advice in `explain` and its row in the page for people."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot_offload.insight.next_steps import INVALID, NEXT_STEPS, advice
from robot_offload.kube import errors
from robot_offload.kube.errors import KubeError

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs" / "how-to" / "troubleshooting.md").read_text()
DECISIONS = {"yes", "no", "unknown", "Obstacle", "Verdict", "Placement"}
"""What a reason is handed to; in `Verdict` and `Placement` it is the second argument."""


def written_in(file: Path) -> Iterator[str]:
    """The reasons that stand as text in a module of the operator."""
    for call in ast.walk(ast.parse(file.read_text())):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in DECISIONS:
            place = 1 if call.func.id in ("Verdict", "Placement") else 0
            if len(call.args) > place:
                yield from texts(call.args[place])


def texts(expression: ast.expr) -> Iterator[str]:
    """The texts that an expression can become: `a or "B"`, `"A" if x else "B"`."""
    for part in ast.walk(expression):
        text = part.value if isinstance(part, ast.Constant) else None
        if isinstance(text, str) and text.isidentifier() and text[0].isupper():
            yield text


def reasons() -> list[str]:
    modules: list[Path] = []
    for package in ("decide", "controller", "runtime"):
        modules += (ROOT / "operator" / "robot_offload" / package).glob("*.py")
    found = {reason for module in modules for reason in written_in(module)}
    found |= {kind.reason for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, KubeError)}
    return sorted(found)


def test_the_reasons_are_found() -> None:
    assert {"Valid", "NameTaken", "NeverConnected", "ImagePullFailing", "Issued", "Forbidden", "RobotGone"} <= set(
        reasons()
    )


@pytest.mark.parametrize("reason", reasons())
def test_every_reason_of_the_operator_has_advice(reason: str) -> None:
    assert reason in NEXT_STEPS, f"cli/next_steps.py lacks {reason}"


@pytest.mark.parametrize("reason", sorted(NEXT_STEPS))
def test_the_page_says_what_explain_says(reason: str) -> None:
    found = NEXT_STEPS[reason]
    step = found.step.replace("{name}", "NAME").replace("{namespace}", "NAMESPACE") or "Nothing to do."
    assert f"| `{reason}` | {found.meaning} | {step} |" in PAGE


def test_an_invalid_specification_and_a_new_reason_have_advice_too() -> None:
    assert INVALID.meaning in PAGE
    assert advice("SpecValid", "TooShort") == INVALID
    assert "log" in advice("WorkloadsAvailable", "FromTheFuture").step
