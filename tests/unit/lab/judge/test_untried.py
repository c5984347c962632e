"""A promise counts as kept only in a run that tried and measured it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Arrival, PlacementChange, Record
from robot_offload_lab.judge.report import build, html
from robot_offload_lab.show.summary import summary
from tests.unit.lab.judge.recordings import calm_run, recording, stay
from tests.unit.lab.judge.test_report import Page


def foreign(record: Record) -> Record:
    """The same message without a name of its own, numbered by the recorder."""
    return dataclasses.replace(record, named=False) if isinstance(record, Arrival) else record


def printed(records: list[Record]) -> tuple[str, str]:
    """What the terminal and the page of a run say."""
    measures = measure(recording(records))
    report = build(measures)
    return "\n".join(summary(report, Path("out"))), Page(html(report, measures)).text


def test_of_messages_that_carry_no_number_losses_and_duplicates_are_not_known() -> None:
    lines, page = printed([foreign(record) for record in calm_run()])
    assert "duplicates, lost and stale not known" in lines
    assert "0 lost" not in lines + page
    assert "All promises were kept" not in lines
    assert "All invariants held" not in page
    assert "not known duplicates of /cmd_vel" in page


def test_messages_with_numbers_are_counted() -> None:
    lines, page = printed(calm_run())
    assert "0 duplicates, 0 lost, 0 stale" in lines
    assert "All promises were kept" in lines
    assert "All invariants held" in page


def test_a_run_in_which_the_cloud_never_acted_tries_no_change() -> None:
    others = [r for r in calm_run() if not isinstance(r, Arrival | PlacementChange)]
    start = [r for r in calm_run() if isinstance(r, PlacementChange)][:1]
    lines, page = printed([others[0], *stay("robot", 0.0, 20.0), *start, *others[1:]])
    assert "The cloud never acted" in lines
    assert "All promises were kept" not in lines
    assert "The cloud never acted" in page
