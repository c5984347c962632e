"""What is read out of the wheel's log, and what the cloud makes of who is connected: without sessions."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.link.port import LinkCause
from robot_offload_agent.link.zenoh_causes import Found, most_telling, read_line
from robot_offload_agent.link.zenoh_rules import Attendance, Repetition

BEGIN = "\x1b[2m2026-11-22T13:13:49Z\x1b[0m \x1b[33m WARN\x1b[0m ThreadId(01) "
DIALLED = BEGIN + "\x1b[2mzenoh::net::runtime::orchestrator\x1b[0m\x1b[2m:\x1b[0m Unable to connect to "
END = " at /build/zenoh/src/net/runtime/orchestrator.rs:447."


@pytest.mark.parametrize(
    ("why", "cause", "detail"),
    [
        ("deadline has elapsed", LinkCause.NO_ANSWER, "deadline has elapsed"),
        ("[127.0.0.1:9: Connection refused (os error 111)", LinkCause.NO_ANSWER, "Connection refused (os error 111)"),
        ("failed to lookup address information: Name or service not known", LinkCause.UNKNOWN_NAME, "Name or service"),
        ("aborted by peer: error 51: invalid peer certificate: BadSignature", LinkCause.CERTIFICATE_REFUSED, "BadSig"),
        ("received fatal alert: DecryptError", LinkCause.CERTIFICATE_REFUSED, "DecryptError"),
        ("error 48: invalid peer certificate: UnknownIssuer", LinkCause.WRONG_AUTHORITY, "UnknownIssuer"),
        ('invalid peer certificate: certificate not valid for name "h"', LinkCause.WRONG_NAME, "not valid for"),
        ("invalid peer certificate: certificate expired: verification", LinkCause.CERTIFICATE_EXPIRED, "expired"),
        ("something new", LinkCause.NO_SESSION, "something new"),
    ],
)
def test_a_failed_attempt_says_why_at_which_endpoint(why: str, cause: LinkCause, detail: str) -> None:
    found = read_line(f"{DIALLED}quic/cloud.example:7447?mixed_rel=1! {why}{END}")
    assert found is not None
    assert (found.cause, found.endpoint) == (cause, "quic/cloud.example:7447")
    assert detail in found.detail
    assert ".rs" not in found.detail


@given(st.text(max_size=300))
def test_any_other_line_says_nothing(text: str) -> None:
    assert read_line(text) is None or "orchestrator" in text or "acceptor" in text or "unicast" in text
    assert read_line(f"{DIALLED}any of [Single({text})]!") is None


@given(st.text(max_size=300))
def test_no_text_from_outside_ends_the_reading(text: str) -> None:
    found = read_line(f"{BEGIN}zenoh_link_tls::unicast: {text}")
    assert found is None or len(found.detail) <= 200
    dialled = read_line(f"{DIALLED}quic/h:1! {text}")
    assert dialled is None or len(dialled.detail) <= 200


def test_of_several_addresses_the_one_that_says_most_counts() -> None:
    found = [
        Found(LinkCause.NO_ANSWER, "", "a"),
        Found(LinkCause.WRONG_AUTHORITY, "", "b"),
        Found(LinkCause.NO_ANSWER, ""),
    ]
    assert most_telling(found) == found[1]
    assert most_telling([]) is None


def test_two_sessions_are_a_changeover_for_a_while_and_then_a_second_robot() -> None:
    attendance = Attendance()
    seen = [attendance.look(tick / 2, 2, tick) for tick in range(20)]
    assert seen[:11] == [LinkCause.NONE] * 11
    assert seen[11:] == [LinkCause.SECOND_SESSION] * 9
    assert attendance.seconds == 1
    assert attendance.look(10.0, 1, 99) is LinkCause.NONE
    assert [attendance.look(10.0 + s, 2, 100 + s) for s in range(7)][-1] is LinkCause.SECOND_SESSION
    assert attendance.seconds == 2


def test_a_connected_robot_that_says_nothing_is_not_ours_until_it_speaks() -> None:
    attendance = Attendance()
    assert [attendance.look(s, 1, 7) for s in (0.0, 1.0, 2.0)] == [LinkCause.NONE] * 3
    assert attendance.look(2.1, 1, 7) is LinkCause.OTHER_IDENTITY
    assert attendance.look(2.6, 1, 8) is LinkCause.NONE
    assert [attendance.look(s, 0, 8) for s in (3.0, 30.0)] == [LinkCause.NONE] * 2
    assert attendance.look(31.0, 1, 8) is LinkCause.NONE


def test_a_sentence_is_repeated_now_and_then() -> None:
    repetition = Repetition(period_s=60.0)
    assert [repetition.is_due("a", t_s) for t_s in (0.0, 1.0, 59.0, 60.0, 61.0)] == [True, False, False, True, False]
    assert repetition.is_due("b", 61.0)
    assert repetition.is_due("c", 200.0)
    assert set(repetition.said) == {"c"}


def test_a_listener_says_who_refused_whom_and_nothing_of_an_attempt_that_was_given_up() -> None:
    quic = f"{BEGIN}zenoh_link_commons::quic::unicast: QUIC acceptor failed: "
    ours = read_line(
        quic + 'TransportError(Error { code: Code::crypto(33), reason: "invalid peer certificate: BadSig" })'
    )
    theirs = read_line(quic + 'ConnectionClosed(ConnectionClose { error_code: Code::crypto(30), reason: b"" })')
    assert ours is not None
    assert (ours.cause, ours.endpoint) == (LinkCause.CERTIFICATE_REFUSED, "")
    assert theirs is not None
    assert theirs.cause is LinkCause.WRONG_AUTHORITY
    given_up = 'ConnectionClosed(ConnectionClose { error_code: NO_ERROR, frame_type: None, reason: b"" })'
    assert read_line(quic + given_up) is None
