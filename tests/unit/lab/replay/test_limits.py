"""Everybody is held to the same hard limits: in silence nobody acts in the cloud."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay.costs import Change, Weights
from robot_offload_lab.replay.limits import adapted_loss_timeout_s, clamped
from robot_offload_lab.replay.named import POLICIES
from robot_offload_lab.replay.study import case, outcome
from tests.unit.lab.replay.cases import beats_of, link, made_case, text

CUT = link((2.0, 10), (1.0, None), (2.0, 10))
LOSS_US = 90_000
ALWAYS = (Change(0, Site.CLOUD, "Always", "the cloud"),)


def test_the_loss_timeout_follows_slow_paths_and_is_never_shorter_than_90_ms() -> None:
    assert adapted_loss_timeout_s(text(*[10] * 9)) == 0.090
    assert adapted_loss_timeout_s(text(*[50] * 9, 900)) == pytest.approx(0.150)


def test_a_timeout_that_was_asked_for_is_not_adapted() -> None:
    asked = Settings(loss_timeout_s=0.2)
    assert case(CUT, asked, Weights(), adapt=False).settings.loss_timeout_s == 0.2
    assert case(CUT, asked, Weights()).settings.loss_timeout_s == 0.090


def test_who_never_leaves_is_made_to_leave_in_silence_and_is_back_with_the_first_arrival() -> None:
    found = clamped(ALWAYS, beats_of(CUT), LOSS_US)
    # The last arrival before the cut is that of the beat of 1.98 s, at 1.99 s.
    assert [(change.at_us / 1e6, change.site, change.reason) for change in found] == [
        (0.0, Site.CLOUD, "Always"), (2.1, Site.ROBOT, "HeartbeatLost"), (3.01, Site.CLOUD, "Always")
    ]  # fmt: skip


def test_a_will_that_changes_during_the_silence_holds_after_it() -> None:
    changes = (*ALWAYS, Change(2_500_000, Site.ROBOT, "Late", ""), Change(4_000_000, Site.CLOUD, "Again", ""))
    found = clamped(changes, beats_of(CUT), LOSS_US)
    assert [(change.at_us / 1e6, change.site) for change in found] == [
        (0.0, Site.CLOUD), (2.1, Site.ROBOT), (4.0, Site.CLOUD)
    ]  # fmt: skip


def test_a_will_for_the_cloud_in_silence_waits_for_its_end() -> None:
    found = clamped((Change(2_500_000, Site.CLOUD, "Early", ""),), beats_of(CUT), LOSS_US)
    assert [(change.at_us / 1e6, change.reason) for change in found] == [(3.01, "Early")]


def test_a_silence_that_never_ends_forbids_the_cloud_to_the_end() -> None:
    trace = link((2.0, 10), (3.0, None))
    found = clamped(ALWAYS, beats_of(trace), LOSS_US)
    assert [change.site for change in found] == [Site.CLOUD, Site.ROBOT]
    assert made_case(trace).price(ALWAYS).exposed_s == pytest.approx(0.1)


def test_without_silence_nothing_is_changed() -> None:
    assert clamped(ALWAYS, beats_of(link((2.0, 10))), LOSS_US) is ALWAYS


def test_the_optimum_is_held_to_the_limits_too() -> None:
    # Leaving and returning costs 1; without the limit bearing 0.09 s of a lost link is cheaper.
    short = link((20.0, 10), (0.2, None), (20.0, 10))
    dear = made_case(short, weights=Weights(10, 1, 5))
    assert dear.unclamped.best.score.cost == pytest.approx(5 + 2.0)
    assert dear.best.score.cost > dear.unclamped.best.score.cost
    assert [change.site for change in dear.best.changes if change.at_us] or dear.best.changes == ()


def test_what_a_policy_alone_wanted_is_kept_beside_what_the_limits_made_of_it() -> None:
    found = outcome(POLICIES["cloud"], made_case(CUT))
    assert found.wishes is not None
    assert [change.site for change in found.wishes] == [Site.CLOUD]
    assert found.score.switches == 3
    assert outcome(POLICIES["cloud"], made_case(CUT).unclamped).score.switches == 1
