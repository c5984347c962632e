"""Who else publishes in front of the consumers, as the graph shows it over time."""

from __future__ import annotations

from robot_offload_core.collector.rivals import NAME_S, PARTICIPANT_LEASE_S, Endpoint, Rivals, Twins

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


def test_a_second_collector_that_comes_after_our_start_is_seen_at_the_second_look() -> None:
    rivals = Rivals("/offload_collector")
    assert rivals.look([OURS], 1, 0.0) == []
    both = [OURS, Endpoint(b"2", "/offload_collector")]
    assert rivals.look(both, 1, 10.0) == []
    assert rivals.look(both, 1, 10.5) == ["a second /offload_collector"]


def test_a_publisher_of_ours_that_is_made_anew_is_no_second_one() -> None:
    rivals = Rivals("/offload_collector")
    assert rivals.look([OURS], 1, 0.0) == []
    anew = Endpoint(b"2", "/offload_collector")
    assert rivals.look([OURS, anew], 1, 10.0, made_s=9.9) == []
    assert rivals.look([anew], 1, 10.5, made_s=9.9) == []


def test_a_publisher_of_ours_that_is_made_late_is_no_second_one_beside_what_an_earlier_collector_left() -> None:
    rivals = Rivals("/offload_collector")
    left = Endpoint(b"0", "/offload_collector")
    assert rivals.look([left], 0, 0.0) == []
    for now_s in (10.0, 10.5, 15.0):
        assert rivals.look([left, OURS], 1, now_s, made_s=9.9) == []


def test_a_second_collector_stays_seen_when_our_publisher_is_made_anew() -> None:
    rivals = Rivals("/offload_collector")
    second, anew = Endpoint(b"2", "/offload_collector"), Endpoint(b"3", "/offload_collector")
    assert rivals.look([OURS], 1, 0.0) == []
    assert rivals.look([OURS, second], 1, 10.0) == []
    assert rivals.look([anew, second], 1, 11.0, made_s=10.9) == ["a second /offload_collector"]


def test_one_without_a_name_has_a_moment_to_get_one() -> None:
    rivals = Rivals("/offload_collector")
    nameless = Endpoint(b"3", "")
    assert rivals.look([nameless], 0, 0.0) == []
    assert rivals.look([nameless], 0, NAME_S) == []
    assert rivals.look([nameless], 0, NAME_S + 0.1) == ["a node without a name"]


FIRST, SECOND = (Endpoint(bytes(11) + bytes([n]) + b"end1", "/walker") for n in (1, 2))


def test_two_lasting_processes_of_one_node_on_a_private_topic_are_two_replicas() -> None:
    twins = Twins("/offload_collector")
    assert twins.look([FIRST, SECOND], 0.0) == []
    assert twins.look([FIRST, SECOND], PARTICIPANT_LEASE_S + 0.1) == ["/walker", "/walker"]
    assert twins.look([SECOND], PARTICIPANT_LEASE_S + 0.2) == []


def test_a_node_that_was_killed_and_started_again_is_no_second_replica() -> None:
    twins = Twins("/offload_collector")
    assert twins.look([FIRST], 0.0) == []
    assert twins.look([FIRST, SECOND], 100.0) == []
    assert twins.look([FIRST, SECOND], 100.0 + PARTICIPANT_LEASE_S) == []
    assert twins.look([SECOND], 101.0 + PARTICIPANT_LEASE_S) == []


def test_what_we_fill_in_and_a_second_publisher_of_one_process_are_no_second_replica() -> None:
    twins = Twins("/offload_collector")
    ours, again = Endpoint(bytes(16), "/offload_collector"), Endpoint(FIRST.identity[:12] + b"end2", "/walker")
    for now_s in (0.0, PARTICIPANT_LEASE_S + 0.1):
        assert twins.look([ours, FIRST, again], now_s) == []
