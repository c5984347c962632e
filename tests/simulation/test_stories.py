"""Small worlds in virtual time, one rule each; and the proof that each planted fault is found by one of them."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from robot_offload_core.collector import gate
from robot_offload_sim.main import app
from robot_offload_sim.mutants.mutant_list import EQUIVALENT, MUTANTS
from robot_offload_sim.mutants.mutants import planted
from robot_offload_sim.stories.stories import STORIES

pytestmark = [pytest.mark.simulation]


@pytest.mark.core
@pytest.mark.parametrize("name", STORIES)
def test_a_story_ends_well(name: str) -> None:
    STORIES[name]()


@pytest.mark.parametrize("name", MUTANTS)
def test_a_planted_fault_is_found_by_its_story(name: str) -> None:
    mutant = MUTANTS[name]
    with planted(mutant), pytest.raises(Exception) as found:  # noqa: PT011 - or the core checks itself
        STORIES[mutant.story]()
    assert not isinstance(found.value, (NameError, SyntaxError, AttributeError)), f"{name}: {found.value!r}"


@pytest.mark.parametrize("name", EQUIVALENT)
def test_an_edit_that_changes_nothing_by_itself_fits_the_core_and_says_why(name: str) -> None:
    with planted(EQUIVALENT[name]):
        assert EQUIVALENT[name].why


def test_the_command_lists_every_planted_fault_and_who_finds_it() -> None:
    listed = CliRunner().invoke(app, ["--mutants"])
    assert listed.exit_code == 0
    rows = [f"{name}: {mutant.meaning} (found by {mutant.story})" for name, mutant in MUTANTS.items()]
    rows += [f"{name}: {edit.meaning} (changes nothing: {edit.why})" for name, edit in EQUIVALENT.items()]
    assert listed.output.splitlines() == rows


def test_the_core_is_whole_again_after_a_mutant() -> None:
    before = gate.set_gate.__code__, gate.PAUSE_S
    for mutant in MUTANTS.values():
        with planted(mutant):
            pass
    assert before == (gate.set_gate.__code__, gate.PAUSE_S)
