"""Consumers in the cloud hear one side at a time, in the order of the stays in charge."""

from __future__ import annotations

from robot_offload_core.fence.token import Token
from robot_offload_core.topics import mirror
from robot_offload_core.topics.mirror import Mirror
from tests.unit.core.builders import CLOUD, ROBOT, STRANGER


def heard(*messages: tuple[str, int], robot: str = ROBOT) -> str:
    """What passes of messages of (kind, epoch): own, own while getting ready, mirrored; by their first letters."""
    state, passed = Mirror(), ""
    for kind, epoch in messages:
        if kind == "mirrored":
            state, passes = mirror.mirrored(state, Token(robot, epoch, ""))
        else:
            state, passes = mirror.own(state, Token(robot, epoch, CLOUD), in_charge=kind == "own")
        passed += kind[0] if passes else "."
    return passed


def test_a_cloud_that_gets_ready_is_not_heard() -> None:
    assert heard(("mirrored", 3), ("getting ready", 4), ("mirrored", 3)) == "m.m"


def test_a_cloud_that_gets_ready_and_is_called_off_was_never_heard() -> None:
    story = [("mirrored", 3), ("getting ready", 4), ("mirrored", 3), ("getting ready", 4), ("mirrored", 5)]
    assert heard(*story) == "m.m.m"


def test_the_cloud_in_charge_ends_the_mirror_of_the_stay_before() -> None:
    assert heard(("mirrored", 3), ("own", 4), ("mirrored", 3), ("own", 4)) == "mo.o"


def test_a_robot_that_has_taken_over_ends_the_cloud_s_own_messages() -> None:
    assert heard(("own", 4), ("mirrored", 5), ("own", 4), ("mirrored", 5)) == "om.m"


def test_one_stay_has_one_side() -> None:
    assert heard(("own", 4), ("mirrored", 4)) == "o."
    assert heard(("mirrored", 4), ("own", 4)) == "m."


def test_another_control_process_of_the_robot_counts_its_epochs_anew() -> None:
    state, _ = mirror.mirrored(Mirror(), Token(ROBOT, 900, ""))
    state, passes = mirror.mirrored(state, Token(STRANGER, 1, ""))
    assert passes
    assert not mirror.mirrored(state, Token(STRANGER, 0, ""))[1]
