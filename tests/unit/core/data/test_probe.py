"""The probe of the data session: read back as written, and nothing else is taken for one."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.data import probe

NAMES = st.text(max_size=probe.MAX_NAME)
TABLES = st.dictionaries(NAMES, NAMES)
TYPES = st.dictionaries(NAMES, st.sampled_from(["std_msgs/msg/Header", "nav_msgs/msg/Odometry"]))
INCARNATIONS = st.just("") | st.text("0123456789abcdef", min_size=32, max_size=32)


@given(st.builds(probe.Probe, INCARNATIONS, TABLES, TYPES, TABLES, st.text(max_size=probe.MAX_WORD), st.text()))
def test_a_probe_is_read_back_as_it_was(sent: probe.Probe) -> None:
    assert probe.decode(probe.encode(sent)) == sent
    sign = probe.Sign(sent.incarnation, probe.signed(sent, "").digest, "held")
    assert probe.decode(probe.encode(sign)) == sign


@given(st.builds(probe.Probe, INCARNATIONS, TABLES, TYPES, TABLES), st.text(max_size=20), st.text(max_size=20))
def test_the_digest_is_of_what_is_held_and_of_nothing_else(sent: probe.Probe, held: str, word: str) -> None:
    signed = probe.signed(sent, held)
    assert signed.held == held
    assert probe.signed(signed, "other").digest == signed.digest
    assert (probe.signed(replace(sent, word=word), held).digest == signed.digest) is (word == sent.word)


def test_a_sign_of_life_fits_one_datagram_however_much_is_held() -> None:
    nodes = {f"node_{n}": "active" for n in range(200)}
    whole = probe.signed(probe.Probe("ab" * 16, nodes=nodes), "0" * 16)
    assert len(probe.encode(whole)) > 3000
    assert len(probe.encode(probe.Sign(whole.incarnation, whole.digest, whole.held))) < 120


@given(st.binary())
def test_bytes_are_a_probe_or_refused_with_a_probe_error(data: bytes) -> None:
    with pytest.raises(probe.ProbeError):
        probe.decode(data)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(st.dictionaries(st.sampled_from(["v", "i", "l", "t", "n", "w"]), JSON))
def test_fields_of_other_types_are_refused(body: dict[str, object]) -> None:
    data = json.dumps({"v": probe.VERSION, **body}).encode()
    try:
        found = probe.decode(data)
    except probe.ProbeError:
        return
    assert probe.decode(probe.encode(found)) == found


@pytest.mark.parametrize(
    "wrong",
    [
        {"i": "robot"}, {"w": "x" * (probe.MAX_WORD + 1)}, {"s": "x" * probe.MAX_BYTES}, {"n": {"x" * 300: "active"}},
        {"l": {str(n): "" for n in range(probe.MAX_ENTRIES + 1)}}, {"t": {"odom": "os/path/join"}}, {"t": {"odom": ""}},
        {"p": True}, {"p": -1},
    ],
)  # fmt: skip
def test_what_no_agent_of_ours_would_say_is_refused(wrong: dict[str, object]) -> None:
    body = json.loads(probe.encode(probe.Probe("ab" * 16)))
    with pytest.raises(probe.ProbeError) as refused:
        probe.decode(json.dumps({**body, **wrong}).encode())
    assert refused.value.reason == "BadForm"


def test_lists_in_lists_without_end_are_refused() -> None:
    with pytest.raises(probe.ProbeError):
        probe.decode(b"[" * 100_000)


def test_another_version_is_refused_by_its_number() -> None:
    with pytest.raises(probe.ProbeError, match="version 1") as refused:
        probe.decode(probe.encode(probe.Probe("")).replace(b'"v":2', b'"v":1'))
    assert refused.value.reason == "OtherVersion"


@given(st.lists(st.binary(), max_size=5), st.lists(st.binary(), max_size=5))
def test_only_the_same_values_in_the_same_order_have_the_same_digest(one: list[bytes], two: list[bytes]) -> None:
    assert (probe.digest(one) == probe.digest(two)) == (one == two)
