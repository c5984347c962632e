"""How old the state of the robot's node is after a cut is worked out from what the node took down."""

from __future__ import annotations

import pytest

from robot_offload_lab.bench.analysis import keeping
from robot_offload_lab.bench.analysis.keeping import StateAccount
from robot_offload_lab.bench.groups.keeping import CASES
from robot_offload_lab.bench.observed import FirstOutput, Observation, SnapshotTaken, Woken
from robot_offload_lab.bench.results import Figure
from tests.unit.lab.bench.stories import arrivals, every, recording

CUT_S = 102.0
BEFORE = (Woken(90.0), SnapshotTaken(90.1, 90.0, 1024), FirstOutput(90.2))
WOKEN = (Woken(102.1), SnapshotTaken(102.11, 101.93, 1024), FirstOutput(102.14))


def account(*kept: Observation) -> StateAccount:
    heard = recording(
        arrivals("cloud", 1, [*every(101.0, 102.0, 0.02)]), arrivals("robot", 1, [*every(102.14, 103.0, 0.05)])
    )
    return StateAccount(CASES[0], (CUT_S,), kept, heard)


def figures(given: StateAccount) -> dict[str, Figure]:
    return {figure.name: figure for figure in keeping.outcome("realtime", [given]).figures}


def test_the_age_is_that_of_the_snapshot_the_node_woke_with_at_the_moment_of_the_cut() -> None:
    found = figures(account(*BEFORE, *WOKEN))
    assert found["age_state-1KiB"].value == pytest.approx(70.0)
    assert (found["age_state-1KiB"].must, found["age_state-1KiB"].aim) == (200.0, 120.0)
    assert found["restore_state-1KiB"].value == pytest.approx(40.0)
    assert found["age_state-1KiB"].title == "State of 1 KiB: age at a sudden cut, p99"


@pytest.mark.parametrize("late", [(), (SnapshotTaken(102.2, 101.93, 1024),)])
def test_a_node_that_spoke_before_it_had_a_snapshot_began_clean(late: tuple[Observation, ...]) -> None:
    found = figures(account(*BEFORE, Woken(102.1), FirstOutput(102.14), *late))
    assert found["age_state-1KiB"].value is None
    assert found["age_state-1KiB"].note == "10 a second; 1 began clean"


def test_a_cut_after_which_no_node_woke_counts_as_nothing_restored() -> None:
    assert keeping.restores(account(*BEFORE))[0] == keeping.Restore(None, None, None)


def test_sizes_are_said_as_people_say_them() -> None:
    assert [keeping.size_in_words(case.state_bytes) for case in CASES] == ["1 KiB", "1 MiB", "16 MiB"]
