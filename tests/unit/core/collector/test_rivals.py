"""Who else publishes in front of the consumers, as the graph shows it over time."""

from __future__ import annotations

from robot_offload_core.collector.rivals import NAME_S, PARTICIPANT_LEASE_S, Endpoint, Rivals

OURS = Endpoint(b"1", "/offload_collector")


def test_another_node_is_named_at_once_whatever_its_name() -> None:
    rivals = Rivals("/offload_collector")
    assert rivals.look([OURS], 1, 0.0) == []
    assert rivals.look([OURS, Endpoint(b"2", "/walker")], 1, 1.0) == ["/walker"]
    assert rivals.look([OURS, Endpoint(b"2", "/other/offload_collector")], 1, 2.0) == ["/other/offload_collector"]
    assert rivals.look([OURS], 1, 3.0) == []


def test_what_an_earlier_collector_left_in_the_graph_is_given_the_time_to_go() -> None:
    rivals = Rivals("/offload_collector")
    left = Endpoint(b"0", "/offload_collector")
    assert rivals.look([left], 0, 0.0) == []
    assert rivals.look([left, OURS], 1, PARTICIPANT_LEASE_S) == []
    assert rivals.look([OURS], 1, PARTICIPANT_LEASE_S + 1) == []


def test_a_second_collector_that_stays_is_seen_although_it_has_our_name() -> None:
    rivals = Rivals("/offload_collector")
    both = [OURS, Endpoint(b"2", "/offload_collector")]
    assert rivals.look(both, 1, 0.0) == []
    assert rivals.look(both, 1, PARTICIPANT_LEASE_S + 0.1) == ["a second /offload_collector"]
    assert rivals.look([OURS], 1, PARTICIPANT_LEASE_S + 0.6) == []


def test_one_without_a_name_has_a_moment_to_get_one() -> None:
    rivals = Rivals("/offload_collector")
    nameless = Endpoint(b"3", "")
    assert rivals.look([nameless], 0, 0.0) == []
    assert rivals.look([nameless], 0, NAME_S) == []
    assert rivals.look([nameless], 0, NAME_S + 0.1) == ["a node without a name"]
