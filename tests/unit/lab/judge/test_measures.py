"""The figures of a run, from made-up recordings whose figures are known."""

from __future__ import annotations

import dataclasses

import pytest

from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Arrival, Ending, LinkSample, NetworkStatus, Record
from robot_offload_lab.judge.streams import Stream, examine, quantile
from tests.unit.lab.judge.recordings import RUN, START_S, calm_run, later, link, placement, recording, stay


def stream(arrivals: list[Arrival], end_s: float = START_S + 10.0) -> Stream:
    return examine("/cmd_vel", sorted(arrivals, key=lambda arrival: arrival.t_s), end_s, RUN.max_command_age_ms)


def test_a_calm_run_has_the_figures_that_were_put_into_it() -> None:
    measures = measure(recording(calm_run()))
    assert measures.duration_s == pytest.approx(20.0)
    assert [(s.before, s.after, s.commanded) for s in measures.switches] == [
        ("robot", "cloud", True),
        ("cloud", "robot", False),
        ("robot", "cloud", True),
    ]
    assert measures.placement_share["robot"] == pytest.approx((2.0 + 4.98) / 20)
    assert measures.good_s == pytest.approx(16.0)
    assert measures.cloud_share_of_good_time == pytest.approx(13.0 / 16.0, abs=0.01)
    assert measures.messages_passed == {"robot": 40 + 99, "cloud": 396 + 250}
    assert (measures.alarms, measures.false_alarms) == (1, 0)
    assert [round(outage.length_s, 3) for outage in measures.outages] == [4.0]


def test_the_gap_of_a_switch_is_the_longest_silence_that_touches_its_window() -> None:
    measures = measure(recording(calm_run()))
    gaps = [switch.gap_ms["/cmd_vel"] for switch in measures.switches]
    assert gaps == pytest.approx([50.0, 150.0, 50.0])


def test_a_silence_longer_than_the_window_counts_as_a_whole() -> None:
    records: list[Record] = [RUN, *stay("cloud", 0.0, 5.0), *stay("robot", 8.0, 10.0), placement(0, "cloud", 1),
               placement(5.1, "robot", 2), Ending(START_S + 10, 0, 0, False)]  # fmt: skip
    [switch] = measure(recording(records)).switches
    assert switch.gap_ms["/cmd_vel"] == pytest.approx(3020.0)


def test_an_output_that_never_returns_is_silent_until_the_end() -> None:
    records: list[Record] = [RUN, *stay("cloud", 0.0, 5.0), placement(0, "cloud", 1), placement(5.1, "robot", 2),
               Ending(START_S + 9, 0, 0, False)]  # fmt: skip
    [switch] = measure(recording(records)).switches
    assert switch.gap_ms["/cmd_vel"] == pytest.approx(4016.0)


def test_what_a_side_publishes_between_two_stays_is_not_lost_even_if_nobody_else_was_heard() -> None:
    records: list[Record] = [RUN, *stay("cloud", 0.0, 5.0), *stay("cloud", 8.0, 10.0), placement(0, "cloud", 1),
               placement(5.1, "robot", 2), placement(7.9, "cloud", 3), Ending(START_S + 10, 0, 0, False)]  # fmt: skip
    assert measure(recording(records)).streams["/cmd_vel"].lost == 0


def test_what_is_missing_within_a_stay_is_lost_also_beside_an_announcement() -> None:
    records: list[Record] = [RUN, *stay("robot", 0.0, 5.0), *stay("cloud", 5.0, 5.1), *stay("cloud", 5.2, 10.0),
               placement(0, "robot", 1), placement(5.15, "cloud", 2), Ending(START_S + 10, 0, 0, False)]  # fmt: skip
    assert measure(recording(records)).streams["/cmd_vel"].lost == 5


def test_nothing_is_judged_after_the_end() -> None:
    records: list[Record] = [RUN, *stay("robot", 0.0, 5.0), placement(0, "robot", 1), placement(4, "cloud", 2),
               Ending(START_S + 3, 0, 0, True)]  # fmt: skip
    measures = measure(recording(records))
    assert measures.switches == ()
    assert measures.messages_passed == {"robot": 60, "cloud": 0}


def test_the_same_message_twice_is_a_duplicate_and_not_reordered() -> None:
    arrivals = stay("robot", 0.0, 1.0)
    found = stream([*arrivals, later(arrivals[3], 0.12)])
    assert found.duplicates == (later(arrivals[3], 0.12),)
    assert found.reordered == ()
    assert found.lost == 0


def test_a_late_message_is_reordered_and_not_lost() -> None:
    arrivals = stay("robot", 0.0, 1.0)
    arrivals[3] = later(arrivals[3], 0.12)
    found = stream(arrivals)
    assert found.reordered == (arrivals[3],)
    assert (found.duplicates, found.lost) == ((), 0)


def test_holes_inside_a_stay_are_lost_and_what_was_published_unheard_is_not() -> None:
    first, second = stay("robot", 0.0, 1.0), stay("robot", 2.0, 3.0)
    del first[4:7]
    found = stream([*first, *stay("cloud", 1.0, 2.0), *second])
    assert found.lost == 3
    assert [hole.count for hole in found.holes] == [3]


def test_a_replica_that_starts_again_counts_from_the_beginning() -> None:
    before = stay("robot", 0.0, 1.0)
    after = [dataclasses.replace(arrival, sequence=n + 1) for n, arrival in enumerate(stay("robot", 2.0, 3.0))]
    found = stream([*before, *after])
    assert (found.duplicates, found.reordered, found.lost) == ((), (), 0)


def test_a_message_older_than_the_limit_is_stale() -> None:
    arrivals = stay("cloud", 0.0, 1.0)
    arrivals[-1] = later(arrivals[-1], 0.2)
    assert stream(arrivals).stale == (arrivals[-1],)


def test_an_alarm_on_a_good_link_is_false() -> None:
    records: list[Record] = [RUN, *link(10.0, [(6.0, 8.0)]), placement(0, "robot", 1),
               *[NetworkStatus(START_S + t, "robot", up) for t, up in ((0, True), (3, False), (4, True), (6.1, False))],
               NetworkStatus(START_S + 5, "cloud", False)]  # fmt: skip
    measures = measure(recording(records))
    assert (measures.alarms, measures.false_alarms) == (2, 1)


def test_time_above_the_threshold_is_not_good() -> None:
    samples = [LinkSample(START_S + t, rtt) for t, rtt in ((0, 20.0), (4, 61.0), (6, 60.0), (9, None))]
    measures = measure(recording([RUN, *samples, placement(0, "cloud", 1), Ending(START_S + 10, 0, 0, True)]))
    assert measures.good_s == pytest.approx(7.0)
    assert measures.cloud_share_of_good_time == pytest.approx(1.0)


def test_a_recording_of_nothing_has_no_figures_and_no_error() -> None:
    measures = measure(recording([RUN]))
    assert measures.switches == ()
    assert measures.placement_share == {}
    assert measures.cloud_share_of_good_time is None


def test_quantiles_are_linear_between_neighbours() -> None:
    assert quantile([], 0.5) is None
    assert quantile([7.0], 0.99) == 7.0
    assert quantile([4.0, 1.0, 3.0, 2.0], 0.5) == pytest.approx(2.5)
    assert quantile([0.0, 100.0], 0.99) == pytest.approx(99.0)
