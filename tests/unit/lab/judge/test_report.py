"""The report of a run: complete figures in JSON, one self-contained page, one picture."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl

from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Ending, PathPoint, Record, Recording
from robot_offload_lab.judge.report import build, html, write
from tests.unit.lab.judge.recordings import RUN, START_S, calm_run, changed, is_arrival, placement, recording, stay


def report_of(of: Recording) -> dict[str, Any]:
    report: dict[str, Any] = json.loads(json.dumps(build(measure(of)), allow_nan=False))
    return report


class Page(HTMLParser):
    """Collects a page's text and what it refers to, and checks that its elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.references: list[str] = []
        self.pictures = 0
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.pictures += tag == "svg"
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def test_the_report_holds_every_promised_figure() -> None:
    report = report_of(recording(calm_run()))
    assert list(report) == [
        *("schema", "mode", "duration_s", "seed", "switches", "outputs", "collisions", "stops", "goal_reached"),
        *("placement_share", "cloud_share_of_good_time", "messages_passed", "detector_alarms", "false_alarms"),
        *("link", "goals", "calls", "state", "processor", "warnings", "busy", "violations", "excused"),
    ]
    assert report["schema"] == "robotoffload.dev/report/v1"
    assert (report["mode"], report["seed"], report["duration_s"]) == ("offload", 7, 20.0)
    assert report["switches"][1] == {
        "t_s": 10.02,
        "from": "cloud",
        "to": "robot",
        "reason": "HeartbeatLost",
        "message": "HeartbeatLost at 10.02 s",
        "epoch": 3,
        "detect_ms": 92.0,
        "gap_ms": {"/cmd_vel": 150.0},
        "lost": 0,
        "duplicates": 0,
    }
    assert report["switches"][0]["detect_ms"] is None
    assert report["outputs"]["/cmd_vel"] == {
        "period_ms": 20.0,
        "received": 785,
        "duplicates": 0,
        "reordered": 0,
        "stale": 0,
        "lost": 0,
        "gap_ms": {"p50": 20.0, "p99": 50.0, "max": 150.0},
        "rated": True,
    }
    assert (report["collisions"], report["stops"], report["goal_reached"]) == (0, 0, True)
    assert report["placement_share"] == {"robot": 0.349, "cloud": 0.651}
    assert report["messages_passed"] == {"robot": 139, "cloud": 646}
    assert report["link"] == {
        "threshold_ms": 60.0,
        "good_s": 16.0,
        "outages": 1,
        "outage_s": 4.0,
        "rtt_ms": {"p50": 20.0, "p99": 20.0, "max": 20.0},
    }
    assert report["violations"] == []


def test_violations_stand_in_the_report_with_time_kind_and_text() -> None:
    silent = changed(calm_run(), lambda record: None if is_arrival(record, "robot", 10.0, 11.0) else record)
    [violation] = report_of(silent)["violations"]
    assert (violation["t_s"], violation["kind"]) == (9.904, "Gap")
    assert violation["text"].startswith("/cmd_vel was silent for 1100 ms")


def test_a_run_that_was_cut_short_still_has_a_report() -> None:
    report = report_of(recording([RUN]))
    assert report["collisions"] is None
    assert report["goal_reached"] is None
    assert report["outputs"] == {}
    assert report["duration_s"] == 0.0


def test_a_run_without_a_wheelchair_has_an_end_and_no_collisions() -> None:
    report = report_of(recording([RUN, *stay("robot", 0.0, 2.0), placement(0, "robot", 1), Ending(START_S + 2.0)]))
    assert report["duration_s"] == 2.0
    assert (report["collisions"], report["stops"], report["goal_reached"]) == (None, None, None)


def test_the_page_is_self_contained_and_says_what_happened() -> None:
    measures = measure(recording(calm_run()))
    page = Page(html(build(measures), measures))
    assert page.open == []
    assert page.pictures == 3
    assert all(reference.startswith("#") for reference in page.references)
    assert "All invariants held." in page.text
    assert "HeartbeatLost" in page.text
    assert "commanded" in page.text


def test_the_page_tells_violations_and_escapes_what_comes_from_outside() -> None:
    records: list[Record] = [
        RUN,
        *stay("robot", 0.0, 2.0, topic="/<b>"),
        placement(0.0, "robot", 1),
        placement(1.0, "cloud", 1, reason="<script>alert(1)</script>"),
        Ending(START_S + 2.0, collisions=1, stops=2, goal_reached=False),
    ]
    measures = measure(recording(records))
    text = html(build(measures), measures)
    assert "<script>" not in text
    assert "/<b>" not in text
    page = Page(text)
    assert "1 broken promise" in page.text
    assert "every changeover must have a higher one" in page.text
    assert page.pictures == 2


def test_a_page_of_nothing_is_still_a_page() -> None:
    measures = measure(recording([RUN]))
    assert "There was no switch." in Page(html(build(measures), measures)).text


def test_the_same_recording_gives_the_same_files(tmp_path: Path) -> None:
    first, second = write(recording(calm_run()), tmp_path / "a"), write(recording(calm_run()), tmp_path / "b")
    for one, other in ((first.json, second.json), (first.html, second.html), (first.png, second.png)):
        assert one.read_bytes() == other.read_bytes()
    assert first.png.read_bytes().startswith(b"\x89PNG")
    assert json.loads(first.json.read_text())["seed"] == 7


def test_drawing_leaves_the_settings_of_matplotlib_alone(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    write(recording(calm_run()), tmp_path)
    assert dict(mpl.rcParams) == before


def test_a_run_of_many_switches_can_be_drawn(tmp_path: Path) -> None:
    records: list[Record] = [
        RUN,
        *stay("robot", 0.0, 60.0),
        *[PathPoint(START_S + t, t / 2, 0.0, 0.5) for t in range(60)],
    ]
    records += [placement(float(t), "robot" if t % 2 else "cloud", t + 1) for t in range(60)]
    files = write(recording(records), tmp_path)
    assert len(json.loads(files.json.read_text())["switches"]) == 59
