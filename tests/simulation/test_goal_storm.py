"""Storms with goals and calls, within CI's budget."""

from __future__ import annotations

import pytest

from robot_offload_sim.stories import goal_storm

SEED = 7

pytestmark = [pytest.mark.simulation, pytest.mark.timeout(1800)]


@pytest.mark.parametrize("index", range(2))
def test_what_clients_were_promised_holds_in_a_storm(index: int) -> None:
    outcome = goal_storm.live(SEED, index)
    assert outcome.violation == "", "\n".join(outcome.story)
    assert outcome.simulated_s >= 60
