"""A recording survives being written and read, and a damaged one is refused with its line."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.errors import RecordingError
from robot_offload_lab.judge.recording import LINES, Obstacle, RecordingWriter, RunInfo, parse, read
from tests.unit.lab.judge.recordings import RUN, calm_run, placement, recording, stay


def test_a_recording_is_read_as_it_was_written(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    run, *records = calm_run()
    assert isinstance(run, RunInfo)
    with file.open("w") as stream:
        writer = RecordingWriter(stream, run)
        for record in records:
            writer.write(record)
    assert read(file) == recording(calm_run())


def test_each_line_is_on_disk_as_soon_as_it_is_written(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    with file.open("w") as stream:
        writer = RecordingWriter(stream, RUN)
        writer.write(placement(0.0, "robot", 1))
        assert len(file.read_text().splitlines()) == 2


def test_records_are_sorted_by_time_and_by_topic() -> None:
    late, early = stay("robot", 1.0, 1.1), stay("robot", 0.0, 0.1)
    other = stay("robot", 0.0, 0.1, topic="/lights")
    got = recording([RUN, *late, *other, *early, Obstacle(1, 2, 3), Obstacle(1, 2, 3)])
    assert got.outputs == {"/cmd_vel": (*early, *late), "/lights": tuple(other)}
    assert got.obstacles == (Obstacle(1, 2, 3),)


def test_without_an_outcome_the_last_thing_seen_is_the_end() -> None:
    assert recording([RUN]).end_s == RUN.start_s
    assert recording([RUN, *stay("robot", 0.0, 2.0)]).end_s == pytest.approx(RUN.start_s + 1.954)


def test_an_unfinished_last_line_is_left_out() -> None:
    text = LINES.encode(RUN) + "\n" + LINES.encode(placement(0.0, "robot", 1)) + "\n" + '{"kind":"arri'
    assert len(parse(io.StringIO(text), "x").placements) == 1


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("not json", "x:2: the line is not JSON"),
        ("[1]", "x:2: the line has no known kind"),
        ('{"kind":"speed"}', "x:2: the line has no known kind"),
        ('{"kind":"link","t_s":1}', "x:2: the line lacks the field rtt_ms of kind link"),
        ('{"kind":"link","t_s":1,"rtt_ms":null,"a":1}', "x:2: the line has unknown fields for kind link: a"),
        ('{"kind":"link","t_s":"1","rtt_ms":null}', "t_s = '1': Input should be a valid number"),
        ('{"kind":"link","t_s":NaN,"rtt_ms":null}', "t_s = nan: Input should be a finite number"),
        ('{"kind":"inhibit","t_s":1,"inhibited":1}', "inhibited = 1: Input should be a valid boolean"),
        ('{"kind":"status","t_s":1,"side":"edge","up":true}', "side = 'edge': Input should be 'robot' or 'cloud'"),
        (json.dumps({"kind": "arrival"}), "lacks the field topic"),
        (LINES.encode(RUN), "holds 2 runs"),
    ],
)
def test_a_damaged_line_is_named(line: str, problem: str) -> None:
    with pytest.raises(RecordingError) as caught:
        parse(io.StringIO(f"{LINES.encode(RUN)}\n{line}\n\n"), "x")
    assert problem in str(caught.value)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the first line must be of kind run"):
        parse(io.StringIO(LINES.encode(placement(0.0, "robot", 1)) + "\n"), "x")
    with pytest.raises(RecordingError, match="holds 0 runs"):
        parse(io.StringIO(""), "x")
    with pytest.raises(RecordingError, match="cannot be read"):
        read(tmp_path / "missing.jsonl")


@given(st.text(max_size=30))
def test_no_line_raises_anything_but_a_value_error(text: str) -> None:
    for line in (text, json.dumps({"kind": text}), json.dumps({"kind": "path", "t_s": text})):
        with pytest.raises(ValueError, match=r"."):
            LINES.decode(line)
