"""Policies by name and a user's own; the one in the docs is tried as it stands there."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload_lab.replay.named import POLICIES, find
from robot_offload_lab.replay.study import outcome
from tests.unit.lab.replay.cases import ROOT, example, link, made_case


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder, forgotten by Python afterwards."""
    monkeypatch.chdir(tmp_path)
    path, modules = list(sys.path), set(sys.modules)
    yield tmp_path
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        del sys.modules[name]


@pytest.mark.parametrize("name", POLICIES)
def test_every_name_is_found_and_can_be_replayed(name: str) -> None:
    found = outcome(find(name), made_case(link((2.0, 10), (1.0, None), (2.0, 10))))
    assert found.policy == name


def test_a_wrong_name_is_told_with_the_right_one() -> None:
    with pytest.raises(InputError, match="no policy 'thesys'; did you mean thesis"):
        find("thesys")


def test_the_policy_of_the_docs_works_as_it_stands_there(here: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "how-to" / "try-a-policy.md").read_text(), re.DOTALL)
    (here / "docs_policy.py").write_text(code)
    subject = example("corridor-wifi.txt")
    found = outcome(find("docs_policy:make"), subject)
    assert found.policy == "docs_policy:make"
    assert found.score.switches >= 3
    assert found.score.cost < outcome(find("robot"), subject).score.cost


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("", "has no function 'make'"),
        ("make = 3", "has no function 'make'"),
        ("def make(:", "cannot import 'foreign_policy': SyntaxError"),
        ("raise OSError('no such thing')", "cannot import 'foreign_policy': OSError: no such thing"),
        ("def make(settings): return object()", "has no method 'heard'"),
        ("def make(settings): return 1 / 0", "ZeroDivisionError"),
        ("def make(): pass", "TypeError"),
        (
            "class P:\n def heard(self, s, a): 0\n def place(self, now): raise KeyError('x')\ndef make(s): return P()",
            "KeyError: 'x'",
        ),
    ],
)
def test_what_is_wrong_with_an_own_policy_is_told_in_one_line(here: Path, code: str, words: str) -> None:
    (here / "foreign_policy.py").write_text(code)
    with pytest.raises(InputError) as caught:
        outcome(find("foreign_policy:make"), made_case(link((2.0, 10))))
    (line,) = caught.value.lines
    assert line.startswith("--policy foreign_policy:make: ")
    assert words in line


def test_a_module_that_does_not_exist_is_told(here: Path) -> None:
    with pytest.raises(InputError, match="cannot import 'missing_module'"):
        find("missing_module:make")
