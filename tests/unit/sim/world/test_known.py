"""What the observer may hold against a process that hears of things a little later."""

from __future__ import annotations

from robot_offload_sim.world.known import Known


def test_what_came_just_now_is_not_known_yet_and_what_came_before_is() -> None:
    known = Known(late_s=0.0025)
    known.came(1.0)
    known.came(1.02)
    assert known.newest_s(1.021) == 1.0
    assert known.newest_s(1.03) == 1.02


def test_a_burst_of_beats_after_a_cut_is_not_known_yet_either() -> None:
    known = Known(late_s=0.0025)
    for came_s in (1.0, 1.09, 1.0901, 1.0902):
        known.came(came_s)
    assert known.newest_s(1.0904) == 1.0
    assert known.newest_s(1.0926) == 1.09
    assert Known(late_s=0.1).newest_s(0.05) == 0.0
