"""Each problem that an agent reports in a run is shown once, with its next step."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload_lab.run.warned import Warned, Warnings, parse

MISSING = "02:41:48.477 WARNING robot.report: No replica in the cloud of: amcl, costmap reason=ReplicaMissing"
MORE = MISSING.replace("costmap", "costmap, planner_server")
DEGRADED = "02:41:48.478 WARNING cloud.report: Should be Active and are not: camera; nobody waits reason=Degraded"


def test_a_problem_has_its_side_its_words_and_the_next_step() -> None:
    found = parse(MISSING)
    assert found is not None
    assert (found.side, found.reason) == ("robot", "ReplicaMissing")
    assert found.message == "No replica in the cloud of: amcl, costmap"
    assert found.sentence() == (
        "The robot's agent warns: No replica in the cloud of: amcl, costmap (ReplicaMissing). "
        "Look at the replica's pod; without it the cloud is not chosen"
    )


@pytest.mark.parametrize(
    "line",
    [
        "",
        "02:41:47.623 WARNING robot.managed_nodes: Inhibiting the driver: CORE node amcl is unknown",
        "02:41:47.623 INFO robot.report: The link is good reason=LinkGood",
        "02:41:47.623 WARNING robot.report: no word at the end",
        "Traceback (most recent call last):",
        "\x00\xff reason=",
    ],
)
def test_other_lines_of_a_log_are_none(line: str) -> None:
    assert parse(line) is None


def test_a_word_that_is_not_ours_is_shown_without_a_next_step() -> None:
    assert parse("1 WARNING cloud.report: Odd reason=Unheard2").sentence().endswith("Odd (Unheard2)")  # type: ignore[union-attr]


def test_each_problem_of_a_side_is_found_once_as_it_is_written(tmp_path: Path) -> None:
    logs = {side: tmp_path / f"{side}-agent.log" for side in ("robot", "cloud")}
    warnings = Warnings(logs)
    warnings.starting = False
    assert list(warnings.look()) == []  # no agent has begun to write
    logs["robot"].write_text(f"{MISSING}\n{MORE}\n02:41:50.001 WARNING rob")
    assert [warned.reason for warned in warnings.look()] == ["ReplicaMissing"]
    with logs["robot"].open("a") as log:
        log.write(f"ot.report: Half a line reason=Thinned\n{MISSING}\n")
    logs["cloud"].write_text(f"{DEGRADED}\n{MISSING.replace('robot.', 'cloud.')}\n")
    assert [(warned.side, warned.reason) for warned in warnings.look()] == [
        ("robot", "Thinned"), ("cloud", "Degraded"), ("cloud", "ReplicaMissing")
    ]  # fmt: skip
    assert list(warnings.look()) == []
    assert len(warnings.found) == 4
    assert warnings.found[0] == Warned("robot", "ReplicaMissing", warnings.found[0].message, warnings.found[0].advice)


def test_while_nodes_come_up_it_is_no_problem_that_they_are_not_there(tmp_path: Path) -> None:
    log = tmp_path / "robot-agent.log"
    log.write_text(f"{MISSING}\n1 WARNING robot.report: Of another type reason=NotLifecycle\n")
    warnings = Warnings({"robot": log})
    assert [warned.reason for warned in warnings.look()] == ["NotLifecycle"]
    warnings.starting = False
    with log.open("a") as file:
        file.write(f"{MORE}\n")
    assert [warned.reason for warned in warnings.look()] == ["ReplicaMissing"]
