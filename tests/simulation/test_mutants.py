"""The simulation's own teeth: every planted fault is found."""

from __future__ import annotations

from itertools import product

import pytest

from robot_offload_lab.simulate.campaign import live
from robot_offload_lab.simulate.mutants import MUTANTS

SEEDS = range(1, 9)
STRETCHES = 10

pytestmark = [pytest.mark.simulation, pytest.mark.timeout(600)]


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_planted_fault_is_found(name: str) -> None:
    for seed, index in product(SEEDS, range(STRETCHES)):
        if live(seed, name, index)[1].violation:
            return
    pytest.fail(f"{name} ({MUTANTS[name].meaning}) lived through all stretches unnoticed")


def test_the_core_is_whole_again_after_a_mutant() -> None:
    live(1, "fence-off", 0)
    assert live(1, None, 0)[1].violation == ""
