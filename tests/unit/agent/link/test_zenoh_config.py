"""The pure parts of the Zenoh link: settings, keys, configuration, and its two rules."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link.zenoh_config import ZenohSettings, acknowledgement_key, key, session_config
from robot_offload_agent.link.zenoh_rules import Backlog, EndpointChoice, Patience, Peer, Struggle, robots


def settings(**changes: Any) -> ZenohSettings:
    values: dict[str, Any] = {
        "side": "robot",
        "session": "data",
        "uid": "wheelchair-7",
        "endpoints": ("quic/cloud.example:7448",),
        "fallback": ("tls/cloud.example:7448",),
        "ca": "ca.pem",
        "certificate": "robot.pem",
        "private_key": "robot.key",
        "peer_name": "cloud",
    }
    return ZenohSettings(**{**values, **changes})


def test_keys_name_robot_offload_sender_session_and_channel() -> None:
    assert key(settings(), "cloud", "out/cmd_vel") == "robot_offload/wheelchair-7/cloud/data/out/cmd_vel"


@pytest.mark.parametrize("name", ["", "/scan", "scan/", "a//b", "a*", "in/$", "in/sc an", "_ack", "ä"])
def test_a_channel_name_that_is_no_key_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match="channel"):
        key(settings(), "robot", name)


def test_acknowledgements_have_a_key_that_no_channel_can_have() -> None:
    assert acknowledgement_key(settings(), "robot").endswith("/robot/data/_ack")


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"uid": ""}, "uid"),
        ({"uid": "a/b"}, "uid"),
        ({"uid": "*"}, "uid"),
        ({"uid": "x" * 64}, "uid"),
        ({"side": "edge"}, "side"),
        ({"session": "video"}, "session"),
        ({"peer_name": ""}, "peer_name"),
        ({"peer_name": "*"}, "peer_name"),
        ({"observers": ("a b",)}, "a b"),
        ({"endpoints": ()}, "endpoints"),
        ({"endpoints": ("udp/0.0.0.0:7447",)}, "udp/0.0.0.0:7447"),
        ({"endpoints": ("tcp/0.0.0.0:7447",)}, "tcp/0.0.0.0:7447"),
        ({"endpoints": ("tls/0.0.0.0:7447",)}, "tls/0.0.0.0:7447"),
        ({"fallback": ("quic/0.0.0.0:7447",)}, "quic/0.0.0.0:7447"),
        ({"endpoints": ("quic/host",)}, "quic/host"),
        ({"endpoints": ("quic/host:0",)}, "quic/host:0"),
        ({"endpoints": ("quic/host:70000",)}, "quic/host:70000"),
        ({"endpoints": ("quic/host:1?rel=0",)}, "rel=0"),
        ({"endpoints": ("quic/::1:7447",)}, "::1"),
        ({"lease_ms": 0}, "lease_ms"),
        ({"fallback_after_ms": -1}, "fallback_after_ms"),
        ({"primary_retry_s": 0}, "primary_retry_s"),
    ],
)
def test_settings_that_cannot_work_are_refused_by_name(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ConfigurationError, match=named.replace("*", r"\*").replace("?", r"\?")):
        settings(**changes)


def test_ipv6_addresses_are_written_in_brackets() -> None:
    assert settings(endpoints=("quic/[::1]:7447",)).endpoints == ("quic/[::1]:7447",)


def test_the_robot_dials_with_its_certificate_and_listens_to_nothing() -> None:
    config = session_config(settings())
    assert config["mode"] == "client"
    assert config["connect"]["endpoints"] == ["quic/cloud.example:7448?mixed_rel=1"]
    assert config["listen"]["endpoints"] == []
    tls = config["transport"]["link"]["tls"]
    assert tls["enable_mtls"] is True
    assert tls["connect_certificate"] == "robot.pem"
    assert "listen_certificate" not in tls


def test_the_robot_dials_either_primary_or_fallback() -> None:
    assert session_config(settings(), fallback=True)["connect"]["endpoints"] == ["tls/cloud.example:7448"]


def test_the_cloud_listens_to_primary_and_fallback_at_once_and_dials_nobody() -> None:
    config = session_config(settings(side="cloud", endpoints=("quic/0.0.0.0:1",), fallback=("tls/0.0.0.0:1",)))
    assert config["mode"] == "router"
    assert config["listen"]["endpoints"] == ["quic/0.0.0.0:1?mixed_rel=auto", "tls/0.0.0.0:1"]
    assert "connect" not in config
    assert config["transport"]["link"]["tls"]["enable_mtls"] is True


@pytest.mark.parametrize("session", ["pulse", "data"])
@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_no_session_is_without_streams_and_none_scouts(side: str, session: str) -> None:
    config = session_config(settings(side=side, session=session))
    text = str(config)
    assert "rel=0" not in text  # a lost declaration makes one direction deaf
    assert "mixed_rel" in text
    assert config["scouting"] == {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    assert config["transport"]["link"]["protocols"] == ["quic", "tls"]


def test_lease_and_name_check_come_from_the_settings() -> None:
    link = session_config(settings(lease_ms=700, verify_name=False))["transport"]["link"]
    assert link["tx"]["lease"] == 700
    assert link["tls"]["verify_name_on_connect"] is False


# -- primary or fallback ----------------------------------------------------------------------------------------------


def test_the_fallback_is_tried_after_the_patience_and_two_tries() -> None:
    choice = EndpointChoice(has_fallback=True, patience_s=5.0)
    assert not choice.failed(0.0, 1.0)
    assert not choice.failed(1.0, 4.9)
    assert choice.failed(5.0, 5.5)
    assert choice.fallback


def test_one_slow_attempt_is_not_enough_for_the_fallback() -> None:
    choice = EndpointChoice(has_fallback=True, patience_s=5.0)
    assert not choice.failed(0.0, 60.0)
    assert choice.failed(60.0, 60.5)


def test_primary_and_fallback_alternate_while_neither_works() -> None:
    choice = EndpointChoice(has_fallback=True, patience_s=2.0)
    seen = []
    for i in range(40):
        choice.failed(i * 0.5, i * 0.5 + 0.4)
        seen.append(choice.fallback)
    assert sum(a != b for a, b in itertools.pairwise(seen)) >= 6


def test_without_a_fallback_the_primary_is_tried_for_ever() -> None:
    choice = EndpointChoice(has_fallback=False, patience_s=1.0)
    assert not any(choice.failed(i, i + 0.5) for i in range(100))
    assert not choice.fallback


def test_after_a_session_on_the_fallback_the_fallback_is_tried_first() -> None:
    choice = EndpointChoice(has_fallback=True, patience_s=5.0)
    choice.opened(fallback=True)
    assert not choice.failed(10.0, 10.5)
    assert choice.fallback


# -- backlog ----------------------------------------------------------------------------------------------------------


def test_bulk_passes_while_it_is_acknowledged_in_time() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0)
    for i in range(1, 200):
        sequence = backlog.admit(i * 0.05)
        assert sequence == i
        if i > 2:
            backlog.acknowledged(i - 2, i * 0.05)  # 100 ms later
    assert len(backlog.waiting) <= 3


def test_bulk_is_refused_while_the_oldest_is_overdue_and_passes_again_when_it_arrives() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0)
    assert backlog.admit(0.0) == 1
    assert backlog.admit(0.1) == 2
    assert backlog.admit(0.2) is None
    assert backlog.acknowledged(1, 0.21), "there is room again"
    assert not backlog.acknowledged(1, 0.215), "said once"
    assert backlog.admit(0.22) == 3


def test_an_acknowledgement_stands_for_all_before_it() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0)
    for i in range(3):
        backlog.admit(i * 0.01)
    backlog.acknowledged(3, 0.03)
    assert not backlog.waiting


def test_lost_acknowledgements_are_not_waited_for_for_ever() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0)
    assert backlog.admit(0.0) == 1
    assert backlog.admit(0.9) is None
    assert backlog.admit(1.1) == 2


def test_where_the_newest_counts_few_are_on_their_way() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0, latest=True)
    assert backlog.admit(0.0) == 1
    backlog.acknowledged(1, 0.04)
    assert backlog.admit(0.1) == 2
    assert backlog.admit(0.15) == 3, "the one before is no older than it has to be"
    assert backlog.admit(0.21) is None, "the oldest has waited for others"
    assert backlog.acknowledged(2, 0.22)
    assert backlog.admit(0.22) == 4


def test_where_the_newest_counts_one_lost_packet_holds_up_no_other_message() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0, latest=True)
    round_trip_s, sent_s = 0.04, 0.0
    for number in range(200):
        lost = number % 3 == 2  # of the packets of a message one in three loses one
        assert backlog.admit(sent_s) is not None
        took_s = round_trip_s * (2.125 if lost else 1.0)  # RFC 9002, section 6.1.2
        if lost:
            assert backlog.admit(sent_s + 0.08) is not None, "the next one, while the lost packet is sent again"
            backlog.acknowledged(backlog.sequence - 1, sent_s + took_s)
            sent_s += 0.08
        backlog.acknowledged(backlog.sequence, sent_s + round_trip_s)
        sent_s += 0.1


def test_where_the_newest_counts_a_path_that_became_longer_is_used_whole() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0, latest=True, least_s=0.01)
    for number in range(500):
        sent_s = number * 0.1
        sequence = backlog.admit(sent_s)
        assert sequence is not None
        backlog.acknowledged(sequence, sent_s + 0.09)
    assert backlog.least_s == pytest.approx(0.09)


def test_sequences_start_again_at_one_after_the_greatest() -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0, sequence=0xFFFFFFFF)
    assert backlog.admit(0.0) == 1


@hypothesis_settings(deadline=None)  # a busy machine is no failure
@given(st.lists(st.tuples(st.floats(0, 0.3), st.integers(-5, 300))))
def test_no_acknowledgement_breaks_the_backlog_or_lets_it_grow(steps: list[tuple[float, int]]) -> None:
    backlog = Backlog(limit_s=0.15, forget_s=1.0)
    now_s, admitted = 0.0, []
    for pause_s, sequence in steps:
        now_s += pause_s
        if backlog.admit(now_s) is not None:
            admitted.append(now_s)
        backlog.acknowledged(sequence, now_s)
        assert all(now_s - sent_s <= 1.0 + 0.3 for _, sent_s in backlog.waiting)
        assert [s for s, _ in backlog.waiting] == sorted(s for s, _ in backlog.waiting)


def test_attempts_are_short_at_first_and_every_second_one_long_later() -> None:
    patience = Patience(short_ms=500, long_ms=3000, short_only_s=12.0)
    assert {patience.next_ms(now_s) for now_s in range(13)} == {500}
    assert sorted({patience.next_ms(20.0), patience.next_ms(21.0)}) == [500, 3000]


def test_after_a_session_attempts_are_short_again() -> None:
    patience = Patience(short_ms=500, long_ms=3000, short_only_s=12.0)
    patience.next_ms(0.0)
    patience.next_ms(20.0)
    patience.succeeded()
    assert [patience.next_ms(21.0), patience.next_ms(22.0)] == [500, 500]


@pytest.mark.parametrize(
    ("protocols", "count"),
    [("", 0), ("quic", 1), ("tls", 1), ("quic tls", 1), ("quic quic", 2), ("quic tls tls", 2), ("tls tls", 2)],
)
def test_a_session_for_large_messages_is_no_second_robot(protocols: str, count: int) -> None:
    assert robots(Peer("walker-1", one) for one in protocols.split()) == count


def test_a_session_struggles_that_refuses_and_takes_again_and_again() -> None:
    one = Struggle()
    said = [one.note(0.1 * number, sent=number % 2 == 0) for number in range(8)]
    assert said == [False] * 6 + [True, True]
    assert not one.note(60.0, sent=True)


def test_a_cut_that_refuses_everything_is_no_struggle() -> None:
    one = Struggle()
    assert not any(one.note(0.1 * number, sent=number < 5) for number in range(50))
    assert not any(one.note(5.0 + 0.1 * number, sent=True) for number in range(50))
