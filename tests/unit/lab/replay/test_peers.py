"""The other rules do what is told of them."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings
from robot_offload_lab.links.recorded import Trace
from robot_offload_lab.replay.contract import SwitchingPolicy
from robot_offload_lab.replay.peers import Dwell, Mean, OneSide, Threshold
from robot_offload_lab.replay.play import play
from tests.unit.lab.replay.cases import beats_of, link

SETTINGS = Settings()
"""Good enough up to 60 ms, lost after 90 ms."""
CUT = link((5.0, 10), (1.0, None), (30.0, 10))
SLOW_SAMPLE = link((5.0, 10), (0.02, 70), (30.0, 10))


def moves(policy: SwitchingPolicy, trace: Trace) -> list[tuple[float, Site]]:
    return [(change.at_us / 1e6, change.site) for change in play(policy, beats_of(trace))]


def test_a_constant_moves_at_the_beginning_or_never() -> None:
    assert moves(OneSide(Site.ROBOT), CUT) == []
    assert moves(OneSide(Site.CLOUD), CUT) == [(0.0, Site.CLOUD)]


def test_the_threshold_moves_with_the_first_echo() -> None:
    assert moves(Threshold(SETTINGS), CUT)[0] == (0.01, Site.CLOUD)


def test_the_threshold_gives_up_after_the_loss_timeout_and_returns_with_the_first_echo() -> None:
    assert moves(Threshold(SETTINGS), CUT)[1:] == [(5.1, Site.ROBOT), (pytest.approx(6.01), Site.CLOUD)]


def test_the_threshold_moves_for_a_single_slow_message() -> None:
    slow = link((5.0, 50), (0.04, 65), (5.0, 55))  # above three medians it would be a stall, this is only slow
    assert [site for _, site in moves(Threshold(SETTINGS), slow)] == [Site.CLOUD, Site.ROBOT, Site.CLOUD]


def test_the_dwell_moves_by_itself_only_after_20_s() -> None:
    found = moves(Dwell(SETTINGS), link((1.0, 50), (10.0, 65), (40.0, 50)))
    assert found == [(0.05, Site.CLOUD)], "by the time that it may leave, the link is good again"
    found = moves(Dwell(SETTINGS), link((1.0, 50), (25.0, 65), (40.0, 50)))
    assert [at_s for at_s, _ in found] == pytest.approx([0.05, 20.06, 40.08], abs=0.03)


def test_the_dwell_leaves_at_once_when_nothing_comes() -> None:
    found = moves(Dwell(SETTINGS), CUT)
    assert [at_s for at_s, _ in found] == pytest.approx([0.01, 5.1, 25.1], abs=0.021)


def test_the_mean_moves_when_the_mean_of_3_s_does() -> None:
    found = moves(Mean(SETTINGS), link((10.0, 50), (10.0, 80)))
    # 50 + 30 x / 3 > 60 for x > 1 s of slow echoes, which come 80 ms late
    assert [at_s for at_s, _ in found] == pytest.approx([0.05, 11.1], abs=0.05)


def test_the_mean_does_not_see_a_loss_for_10_s() -> None:
    found = moves(Mean(SETTINGS), link((5.0, 10), (12.0, None), (5.0, 10)))
    assert [at_s for at_s, _ in found] == pytest.approx([0.01, 15.0, 17.01], abs=0.03)
