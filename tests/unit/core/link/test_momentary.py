"""Latency and loss of a link as of now."""

from __future__ import annotations

import pytest

from robot_offload_core.link.links import Link
from robot_offload_core.link.momentary import LOSS_WINDOW_S, Glance, Watched, glance, watch

PERIOD_S = 0.02


def seen(*beats: tuple[float, int, int]) -> Watched:
    """Looks at a link: time, newest sequence number, beats received."""
    watched = Watched()
    for now_s, last, received in beats:
        link = Link("cloud", now_s, now_s, 0.012, (0.012,), None, 0, last, received)
        watched = watch(watched, link, now_s)
    return watched


def test_nothing_is_known_of_a_link_that_was_never_heard() -> None:
    assert glance(Watched(), 1.0, PERIOD_S) == Glance()
    assert glance(watch(Watched(), Link(), 1.0), 1.0, PERIOD_S) == Glance()


def test_loss_is_that_of_the_last_seconds() -> None:
    watched = seen((0.0, 0, 1), (1.0, 50, 1), (1.5, 75, 26), (3.6, 175, 126))
    assert glance(watched, 3.6, PERIOD_S) == Glance(12.0, 0.0)
    assert glance(seen((0.0, 0, 1), (1.0, 50, 26)), 1.0, PERIOD_S).loss_share == 0.5


def test_silence_is_loss_and_latency() -> None:
    watched = seen((0.0, 0, 1), (1.0, 50, 51))
    later = glance(watch(watched, watched.seen[-1][1], 3.5), 3.5, PERIOD_S)
    assert later.loss_share == 1.0
    assert later.latency_ms == pytest.approx(2460.0)


def test_a_sender_that_begins_again_is_no_loss() -> None:
    watched = watch(seen((0.0, 900, 901)), Link("cloud", 1.0, 1.0, 0.012, (), None, 0, 10, 11), 1.0)
    assert glance(watched, 1.0, PERIOD_S).loss_share == 0.0
    another = watch(watched, Link("another", 1.1, 1.1, 0.012, (), None, 0, 10, 5), 1.1)
    assert len(another.seen) == 1


def test_what_is_kept_is_bounded_by_the_window() -> None:
    watched = seen(*((number * 0.16, number * 8, number * 8 + 1) for number in range(500)))
    assert len(watched.seen) <= LOSS_WINDOW_S / 0.16 + 3
    assert not any(link.window for _, link in watched.seen)
