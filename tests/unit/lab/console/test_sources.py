"""The console's sources on a developer's machine: recordings, and other rules on what was seen of a link."""

from __future__ import annotations

import asyncio
import io
import json
from pathlib import Path

import pytest

from robot_offload.console.actions import Action, Want
from robot_offload.console.live import Key, Point
from robot_offload.console.model import Fleet
from robot_offload.errors import InputError
from robot_offload_lab.console.other_rules import judge
from robot_offload_lab.console.recorded import RecordedSource
from robot_offload_lab.judge.recording import (
    Arrival,
    Ending,
    LinkSample,
    PlacementChange,
    RecordingWriter,
    Restored,
    RunInfo,
)

RUN = RunInfo("offload", 1, 100.0, 150.0, 90.0, 250.0, 50.0, 20.0, 60.0)


def recorded(folder: Path) -> Path:
    """A run of four seconds: the cloud acts from 1 s to 3 s, the link is cut from 3 s on."""
    stream = io.StringIO()
    writer = RecordingWriter(stream, RUN)
    writer.write(PlacementChange(100.0, "robot", 1, "Starting"))
    writer.write(PlacementChange(101.0, "cloud", 2, "LinkGood", "good for long enough"))
    writer.write(PlacementChange(103.0, "robot", 3, "HeartbeatLost", "silent", 91.0))
    for n in range(40):
        t_s = 100.0 + n / 10
        writer.write(LinkSample(t_s, None if n >= 30 else 12.0))
        writer.write(Arrival("/cmd_vel", t_s, "controller", n, t_s - 0.004, "robot" if n < 10 or n >= 30 else "cloud"))
    writer.write(Restored(101.1, "remote_localiser", "cloud", 0.25))
    writer.write(Ending(104.0))
    file = folder / "recording.jsonl"
    file.write_text(stream.getvalue())
    return file


def read(path: Path) -> Fleet:
    source = RecordedSource(path)
    fleet = source.fleet()
    asyncio.run(source.run(fleet.take))
    return fleet


def test_a_recording_is_there_from_its_start_to_its_end(tmp_path: Path) -> None:
    fleet = read(recorded(tmp_path).parent)
    [track] = fleet.sorted()
    assert fleet.recorded
    assert [(round(change.t_s, 1), change.to) for change in track.changeovers] == [(1.0, "cloud"), (3.0, "robot")]
    assert track.changeovers[0].gap_ms == pytest.approx(100.0, abs=1.0)
    assert [track.at(t_s).site for t_s in (0.5, 2.0, 3.9)] == ["robot", "cloud", "robot"]
    assert (track.at(2.0).latency_ms, track.live.cut) == (12.0, True)
    assert track.bounds.allowed_ms == 60.0
    [flow] = track.live.topics
    assert (flow.topic, flow.messages, round(flow.age_ms or 0)) == ("/cmd_vel", 40, 4)
    assert track.live.state_ages_ms == (("remote_localiser", 250.0),)


def test_the_resource_that_ran_is_shown_when_the_demo_left_it_beside_the_recording(tmp_path: Path) -> None:
    file = recorded(tmp_path)
    written = {"metadata": {"name": "wheelchair"}, "spec": {"nodes": [{"name": "controller"}]}}
    (tmp_path / "robotoffload.json").write_text(json.dumps(written))
    assert Key("", "wheelchair") in read(file).tracks
    (tmp_path / "robotoffload.json").write_text("[torn")
    assert Key("", "offload") in read(file).tracks


def test_in_a_recording_nothing_can_be_changed(tmp_path: Path) -> None:
    source = RecordedSource(recorded(tmp_path))
    may = asyncio.run(source.may(Key("", "offload"), Action(Want.PIN_ROBOT)))
    assert (may.allowed, may.reason) == (False, "this is a recording: nothing can be changed in it")


def test_a_folder_without_a_recording_says_what_to_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name a demo's folder, or its"):
        RecordedSource(tmp_path)


def points(seconds: float, cut_from_s: float = 1e9, latency_ms: float = 10.0) -> list[Point]:
    times_s = [n / 5 for n in range(round(seconds * 5))]
    return [Point(t, latency_ms, None, None, "robot", cut=t >= cut_from_s) for t in times_s]


def test_on_a_good_link_every_rule_but_the_robot_goes_to_the_cloud() -> None:
    rows = {each["rule"].split(":")[0]: each for each in judge(points(30), {})}
    assert rows["robot"]["cloud"] == "0 %"
    assert rows["cloud"]["cloud"] == "100 %"
    assert rows["optimum"]["cost"] <= rows["ours"]["cost"]
    assert rows["ours"]["exposed"] == "0.0 s"


def test_a_slow_phase_is_slow_for_as_long_as_it_was_seen() -> None:
    slow = [*points(10), *(Point(10 + n / 5, 120.0, None, None, "robot") for n in range(50))]
    rows = {each["rule"].split(":")[0]: each for each in judge(slow, {})}
    assert float(rows["cloud"]["exposed"].split()[0]) == pytest.approx(9.8, abs=0.3)


@pytest.mark.parametrize("few", [[], points(0.2), points(4)])
def test_a_stretch_that_is_too_short_is_not_judged(few: list[Point]) -> None:
    with pytest.raises(InputError, match="before 5 s"):
        judge(few, {})
