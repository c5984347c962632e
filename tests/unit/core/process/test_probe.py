"""The probe of the data session: read back as written, and nothing else is taken for one."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.process import probe

TABLES = st.dictionaries(st.text(), st.text())


@given(st.builds(probe.Probe, st.text(), TABLES, TABLES, TABLES, st.text()))
def test_a_probe_is_read_back_as_it_was(sent: probe.Probe) -> None:
    assert probe.decode(probe.encode(sent)) == sent


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


def test_another_version_is_refused_by_its_number() -> None:
    with pytest.raises(probe.ProbeError, match="version 2"):
        probe.decode(probe.encode(probe.Probe("")).replace(b'"v":1', b'"v":2'))


@given(st.lists(st.binary(), max_size=5), st.lists(st.binary(), max_size=5))
def test_only_the_same_values_in_the_same_order_have_the_same_digest(one: list[bytes], two: list[bytes]) -> None:
    assert (probe.digest(one) == probe.digest(two)) == (one == two)
