"""Commit messages: what the hook and `make lint` accept, on messages and in real repositories."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scripts.commit_messages import main, problems

ROOT = Path(__file__).parents[3]
WHY = "\n\nA robot that waits moves late. The wait had no end.\n"


def test_an_imperative_subject_with_two_sentences_is_accepted() -> None:
    assert list(problems("End the wait for a partner" + WHY)) == []
    assert list(problems("judge: Do not report a late announcement" + WHY)) == []


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ("", "is empty"),
        ("A" * 61 + WHY, "61 characters"),
        ("The robot waits for nothing" + WHY, "'The'"),
        ("Fixing the wait" + WHY, "'Fixing'"),
        ("Added an end to the wait" + WHY, "'Added'"),
        ("End the wait." + WHY, "full stop"),
        ("End the wait\nIt had no end. It was long.", "not empty"),
        ("End the wait", "fewer than 2 sentences"),
        ("End the wait\n\nIt had no end.", "fewer than 2 sentences"),
        ("End the wait\n\n# A comment. Of git.\n", "fewer than 2 sentences"),
    ],
)
def test_each_broken_rule_is_named(message: str, named: str) -> None:
    assert any(named in problem for problem in problems(message))


@pytest.mark.parametrize("subject", ["Feed the robot", "Bring the arm", "Need a pin", "Embed the chart"])
def test_verbs_that_look_like_participles_are_accepted(subject: str) -> None:
    assert list(problems(subject + WHY)) == []


def test_what_git_writes_itself_is_accepted() -> None:
    assert list(problems("Merge branch 'main' into a-name-that-is-much-longer-than-sixty-characters-for-sure")) == []


def test_the_hook_ends_with_one_for_a_message_without_a_body(tmp_path: Path) -> None:
    file = tmp_path / "COMMIT_EDITMSG"
    file.write_text("End the wait\n# Please enter the commit message. Lines with # are ignored.\n")
    assert main([str(file)]) == 1
    file.write_text("End the wait" + WHY)
    assert main([str(file)]) == 0


def test_a_repository_without_the_old_history_passes_and_says_so(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin:/usr/local/bin"}
    command = [sys.executable, "-m", "scripts.commit_messages"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "not checked" in done.stderr
