"""Durations: text with a unit in YAML, whole milliseconds in Python."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.v1alpha1.quantities import format_duration, parse_duration


@pytest.mark.parametrize(
    ("text", "milliseconds"),
    [("20ms", 20), ("90s", 90_000), ("10m", 600_000), ("2h", 7_200_000), ("0s", 0), ("1m30s", 90_000), ("1s5ms", 1005)],
)
def test_a_duration_is_read_in_milliseconds(text: str, milliseconds: int) -> None:
    assert parse_duration(text) == milliseconds


@pytest.mark.parametrize(
    ("given_value", "advice"),
    [
        (20, "write 20ms or 20s"),
        (0.5, "write 0.5ms or 0.5s"),
        ("1.5s", "1500ms for 1.5s"),
        ("20", "a whole number and a unit"),
        ("20 ms", "a whole number and a unit"),
        ("-5ms", "a whole number and a unit"),
        ("5ms1s", "a whole number and a unit"),
        ("", "a whole number and a unit"),
        (True, "a whole number and a unit"),
        (None, "a whole number and a unit"),
        (["20ms"], "a whole number and a unit"),
    ],
)
def test_what_is_no_duration_is_refused_with_the_right_form(given_value: object, advice: str) -> None:
    with pytest.raises(ValueError, match=r"duration|fraction") as caught:
        parse_duration(given_value)
    assert advice in str(caught.value)


def test_a_duration_is_written_with_the_largest_unit_that_divides_it() -> None:
    assert [format_duration(ms) for ms in (0, 150, 1500, 90_000, 600_000, 7_200_000)] == [
        "0s",
        "150ms",
        "1500ms",
        "90s",
        "10m",
        "2h",
    ]


@given(st.integers(min_value=0, max_value=999_999_999))
def test_writing_and_reading_give_the_same_duration(milliseconds: int) -> None:
    assert parse_duration(format_duration(milliseconds)) == milliseconds
