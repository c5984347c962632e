"""The fence is explored whole: every interleaving within the bounds, with whatever decides above it as an adversary."""

from __future__ import annotations

import pytest

from robot_offload_sim.mutants.mutants import Mutant, planted
from tests.simulation.fence.bounds import Bounds
from tests.simulation.fence.cloud_world import CloudWorld
from tests.simulation.fence.explore import Explored, World, explore
from tests.simulation.fence.faults import FAULTS, ONE_LIFE, SECOND_GUARDS, TWO_LIVES, Fault, SecondGuard
from tests.simulation.fence.gate_world import GateWorld

pytestmark = pytest.mark.core
MOST = 400_000
"""More states than a world with a planted fault needs until the fault is found."""


def whole(world: World) -> Explored:
    """Explore a world to its end."""
    found = explore(world)
    assert not found.broken, "\n".join([*found.story, found.broken])
    assert found.complete
    return found


@pytest.mark.parametrize("bounds", [Bounds(epochs=3, robots=1), Bounds(epochs=2)], ids=["one life", "two lives"])
def test_nothing_leaves_the_cloud_later_than_a_lease_after_it_was_permitted(bounds: Bounds) -> None:
    assert whole(CloudWorld(bounds)).states > 10_000


@pytest.mark.parametrize("bounds", [ONE_LIFE, TWO_LIVES], ids=["one life", "two lives"])
def test_consumers_hear_one_side_per_stay_and_never_an_older_stay_an_old_message_or_one_twice(bounds: Bounds) -> None:
    assert whole(GateWorld(bounds)).states > 10_000


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_planted_in_the_fence_is_found_with_a_story(fault: Fault) -> None:
    with planted(Mutant(fault.meaning, "", fault.edits)):
        found = explore(fault.world(fault.bounds), MOST)
    assert fault.found in found.broken


@pytest.mark.parametrize("guard", SECOND_GUARDS.values(), ids=SECOND_GUARDS)
def test_a_rule_without_which_nothing_breaks_is_a_second_guard(guard: SecondGuard) -> None:
    with planted(Mutant(guard.meaning, "", (guard.edit,))):
        alone = explore(guard.world(ONE_LIFE))
    with planted(Mutant(guard.meaning, "", (guard.edit, guard.twin))):
        both = explore(guard.world(ONE_LIFE), MOST)
    assert alone.complete
    assert not alone.broken
    assert both.broken
