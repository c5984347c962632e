"""The protocol in two hours of virtual time. Longer runs: `make simulate ARGS="--hours H --seed N"`."""

from __future__ import annotations

from typing import Any
from unittest import mock

import pytest

from robot_offload_sim import campaign
from robot_offload_sim.campaign import Total
from robot_offload_sim.main import replay_command
from robot_offload_sim.stories.stage import Stage
from robot_offload_sim.stories.stories import STORIES
from robot_offload_sim.world.coverage import Pair

HOURS = 2.0
"""About five minutes of processor time; what it takes to meet the rarest pairs comes on top."""
SEED = 24
MORE = 12
MOST = 240
"""Stretches added at a time, and at most, while a pair of state and event has not been met: chance alone decides."""

pytestmark = [pytest.mark.simulation, pytest.mark.campaign, pytest.mark.timeout(3600)]


def pairs_of_stories() -> set[Pair]:
    """Returns the pairs that the stories meet: what chance meets once in many hours is there by intent."""
    stages: list[Stage] = []
    make = Stage.__init__

    def noted(self: Stage, *arguments: Any, **options: Any) -> None:
        make(self, *arguments, **options)
        stages.append(self)

    with mock.patch.object(Stage, "__init__", noted):
        for story in STORIES.values():
            story()
    return {pair for stage in stages for pair in stage.system.coverage.pairs}


@pytest.fixture(scope="module")
def met_in_stories() -> set[Pair]:
    return pairs_of_stories()


@pytest.fixture(scope="module")
def total(met_in_stories: set[Pair]) -> Total:
    result = Total()
    planned = campaign.chunks_for(HOURS)
    indices = range(planned)
    while indices:
        for index, outcome in campaign.run(SEED, indices, workers=2):
            result.add(index, outcome)
        more = bool(set(result.missing) - met_in_stories) and indices.stop < planned + MOST
        indices = range(indices.stop, indices.stop + MORE) if more else range(0)
    return result


def test_no_invariant_breaks_in_hours_of_faults(total: Total) -> None:
    told = [f"{b.text} -- {replay_command(SEED, b.index)}" for b in total.broken]
    assert told == []


def test_every_stretch_is_replayed_from_its_black_boxes(total: Total) -> None:
    assert total.unreplayed == []


def test_a_simulated_hour_holds_at_least_a_thousand_faults(total: Total) -> None:
    assert total.faults / (total.simulated_s / 3600) >= 1000


def test_every_pair_of_state_and_event_that_can_occur_was_met(total: Total, met_in_stories: set[Pair]) -> None:
    assert set(total.missing) - met_in_stories == set()
    assert len(total.missing) <= 10  # storms are to meet all but the rarest


def test_both_kinds_of_changeover_happen_often(total: Total) -> None:
    assert total.commanded > 500
    assert total.sudden > 200


def test_the_same_seed_gives_the_same_run() -> None:
    first, again = campaign.live(SEED, None, False, 4)[1], campaign.live(SEED, None, False, 4)[1]
    assert (first.events, first.faults, first.pairs) == (again.events, again.faults, again.pairs)
