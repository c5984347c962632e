"""The watch is blind when lists show what it has not brought."""

from __future__ import annotations

from robot_offload.runtime.health import Limit, WatchSight, healthy


def roff(version: int, uid: str = "u") -> dict[str, dict[str, str]]:
    return {"metadata": {"uid": uid, "resourceVersion": str(version)}}


def test_a_watch_that_brings_everything_is_never_behind() -> None:
    sight = WatchSight()
    sight.delivered(roff(5))
    assert sight.listed([roff(5)], 10) == []
    sight.delivered(roff(7))
    assert sight.listed([roff(6)], 20) == []  # the list was a little older
    assert sight.blind_s(100) == 0


def test_a_missing_version_counts_from_when_it_was_first_missed() -> None:
    sight = WatchSight()
    sight.delivered(roff(5))
    assert sight.listed([roff(6)], 10) == [roff(6)]
    assert sight.listed([roff(9)], 20) == [roff(9)]
    assert sight.blind_s(30) == 20


def test_what_the_watch_brings_late_is_forgiven() -> None:
    sight = WatchSight()
    sight.listed([roff(6)], 10)
    sight.delivered(roff(5))
    assert sight.blind_s(30) == 20
    sight.delivered(roff(6))
    assert sight.blind_s(30) == 0


def test_objects_that_are_gone_are_forgotten() -> None:
    sight = WatchSight()
    sight.listed([roff(6)], 10)
    sight.listed([], 20)
    assert sight.blind_s(100) == 0
    sight.delivered(roff(1, "v"))
    sight.delivered(roff(2, "v"), gone=True)
    assert sight.seen == {}


def test_one_sign_that_is_too_old_makes_the_whole_unhealthy_and_is_named() -> None:
    fine, told = healthy([Limit("leader loop", 1, 60), Limit("list", 400, 300)])
    assert not fine
    assert "too old" in told["list"]
    assert "too old" not in told["leader loop"]
