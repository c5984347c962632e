"""The failing lines of a build: what a person would have looked for in the log."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.decide.build_log import MAX_LINES, failing_lines

STEP = 'Error: building at STEP "RUN --mount=type=cache set -e": while running runtime: exit status 2'


def pod(message: str, *, code: int = 1, step: str = "build", **ended: Any) -> dict[str, Any]:
    state = {"terminated": {"exitCode": code, "message": message, **ended}}
    return {"status": {"initContainerStatuses": [{"name": step, "state": state}]}}


@pytest.mark.parametrize(
    ("log", "line"),
    [
        (f"[1/2] compiling\n/ws/src/a.cpp:7:3: error: 'foo' was not declared\nmake: *** [all] x\n{STEP}", "a.cpp:7:3"),
        (f"E: Unable to locate package libfoo-dev\n{STEP}", "E: Unable to locate package libfoo-dev"),
        ("fatal: couldn't find remote ref v9", "fatal: couldn't find remote ref v9"),
        (f"Package a has no executable b. It has:\nc\n{STEP}", "Package a has no executable b. It has:"),
        ("Error: writing blob: denied: requested access to the resource is denied", "denied: requested access"),
        (STEP, "building at STEP"),
        ("one\ntwo\nthree", "three"),
    ],
)
def test_the_line_that_tells_the_cause_is_found(log: str, line: str) -> None:
    assert line in failing_lines([pod(log)])


def test_the_step_stands_before_each_line_and_the_rest_of_the_log_is_left_out() -> None:
    found = failing_lines([pod("\n".join(f"noise {i}" for i in range(50)) + f"\nerror: broken\n{STEP}", step="fetch")])
    assert all(line.startswith("fetch: ") for line in found.splitlines())
    assert len(found.splitlines()) <= MAX_LINES


def test_colours_and_control_characters_stay_out_of_the_status() -> None:
    assert failing_lines([pod("\x1b[31merror: red\x1b[0m\x07\r")]) == "build: error: red"


def test_of_a_long_line_the_beginning_and_the_cause_at_its_end_are_kept() -> None:
    found = failing_lines([pod("Error: pushing image " + "x" * 9000 + ": denied: wrong password")])
    assert len(found) < 600
    assert found.startswith("build: Error: pushing image")
    assert found.endswith("denied: wrong password")


def test_who_says_nothing_is_told_by_the_code() -> None:
    assert failing_lines([pod("", code=137, reason="OOMKilled")]) == (
        "build: ended with code 137 (OOMKilled) and said nothing"
    )


def test_without_a_pod_there_is_nothing_to_tell() -> None:
    assert failing_lines([]) == ""
    assert failing_lines([pod("fine", code=0)]) == ""
