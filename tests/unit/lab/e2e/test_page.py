"""The page of the end-to-end figures."""

from __future__ import annotations

from tests.e2e.bench import page
from tests.e2e.figures import Figure, shown


def test_figures_stand_under_the_title_of_their_group_with_what_was_aimed_at() -> None:
    text = page.text(
        [
            Figure("latency", "Zenoh, wire 10 ms: added one way p50", 1.234, "ms"),
            Figure("recovery", "cut of 1 s: mended to first cloud command, median of 5", None, "s"),
        ],
        quick=True,
    )
    assert "--quick" in text
    assert "## Ten topics at 10 Hz through each transport" in text
    assert "| Zenoh, wire 10 ms: added one way p50 | 1.23 ms | 2.5 (must 4) |" in text
    assert "median of 5 | - s |  |" in text, "nothing measured is no zero"


def test_numbers_are_short() -> None:
    assert [shown(each) for each in (None, 0.0, 3.0, 1.2345, 1234.5)] == ["-", "0", "3", "1.23", "1234"]
