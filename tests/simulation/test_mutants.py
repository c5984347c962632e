"""The simulation's own teeth: every planted fault is found."""

from __future__ import annotations

import pytest

from robot_offload_core import collectors
from robot_offload_lab.simulate.mutant_list import MUTANTS
from robot_offload_lab.simulate.mutants import planted

pytestmark = [pytest.mark.simulation]


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_planted_fault_fits_the_core_and_leaves_it_whole(name: str) -> None:
    before = collectors.set_gate.__code__, collectors.PAUSE_S
    with planted(MUTANTS[name]):
        pass
    assert before == (collectors.set_gate.__code__, collectors.PAUSE_S)
