"""The robot's agent writes down the link, and the recording can be replayed."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.main import recording
from robot_offload_agent.record.link_csv import Recorder
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.link.links import Link
from robot_offload_core.words.settings import Settings
from robot_offload_lab.links.recorded import load_trace
from robot_offload_lab.replay.costs import Weights
from robot_offload_lab.replay.study import case

PERIOD_S = 0.020


def drive(recorder: Recorder, count: int, lost: range = range(0), from_s: float = 100.0) -> None:
    """Beats with a round trip of 10 ms, some of them never echoed."""
    for index in range(count):
        sent_s = from_s + index * PERIOD_S
        if index not in lost:
            recorder.take(Link(echo_sent_s=sent_s, round_trip_s=0.010))
        recorder.flush(sent_s + 0.010)
    recorder.flush(from_s + count * PERIOD_S + 10)


def test_a_recording_is_a_trace_of_the_same_length_and_round_trips(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    drive(Recorder(file, PERIOD_S), 500)
    trace = load_trace(file)
    assert trace.duration_s == pytest.approx(10.0)
    assert set(trace.rtts_ms) == {10.0}


def test_beats_that_were_not_echoed_are_lost_ones(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    drive(Recorder(file, PERIOD_S), 500, lost=range(200, 300))
    subject = case(load_trace(file), Settings(), Weights())
    assert 1 - subject.beats.good(subject.limit_us).mean() == pytest.approx(0.2, abs=0.01)


def test_one_beat_that_was_not_echoed_is_no_loss(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    drive(Recorder(file, PERIOD_S), 100, lost=range(50, 51))
    assert None not in load_trace(file).rtts_ms


def test_an_echo_that_is_told_again_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    recorder = Recorder(file, PERIOD_S)
    for _ in range(5):
        recorder.take(Link(echo_sent_s=1.0, round_trip_s=0.010))
    recorder.take(Link())
    recorder.flush(10.0)
    assert file.read_text().splitlines() == ["t_s,rtt_ms", "0.0000,10.00"]


def test_a_full_file_makes_way_and_both_can_be_replayed(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    drive(Recorder(file, PERIOD_S, max_bytes=3000), 1000)
    older = tmp_path / "link.csv.1"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.csv", "link.csv.1"]
    assert all(path.stat().st_size <= 3100 for path in (file, older))
    assert load_trace(older).duration_s > 1
    assert load_trace(file).duration_s > 1


def test_a_new_run_keeps_the_recording_of_the_last_one(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    drive(Recorder(file, PERIOD_S), 100)
    drive(Recorder(file, PERIOD_S), 200)
    assert load_trace(tmp_path / "link.csv.1").duration_s == pytest.approx(2.0)
    assert load_trace(file).duration_s == pytest.approx(4.0)


def test_a_folder_that_is_gone_ends_the_recording_and_nothing_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        recorder = Recorder(tmp_path / "gone" / "link.csv", PERIOD_S)
        drive(recorder, 200)
    assert recorder.ended
    assert [record.message.split(":")[0] for record in caplog.records] == ["RecordingEnded"]


def configuration(side: str) -> Configuration:
    return Configuration({"side": side}, (), (), ())


def test_the_option_names_the_file_for_the_robot_only(tmp_path: Path) -> None:
    file = tmp_path / "link.csv"
    assert recording(configuration("robot"), file)["record_file"] == str(file)
    with pytest.raises(ConfigurationError, match="only the robot's agent records the link"):
        recording(configuration("cloud"), file)
    with pytest.raises(ConfigurationError, match="does not exist; make it first"):
        recording(configuration("robot"), tmp_path / "none" / "link.csv")
