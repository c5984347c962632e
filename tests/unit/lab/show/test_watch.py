"""What a person is told while a run goes on, and the views that show it."""

import dataclasses
import io
import json
import os

from rich.console import Console

from robot_offload_lab.judge import translate
from robot_offload_lab.judge.recording import LINES, Arrival, LinkSample, PlacementChange
from robot_offload_lab.show.view import LineView, LiveView, Terminal, picture
from robot_offload_lab.show.watch import LiveRun
from tests.unit.lab.judge.test_translate import state


def message(watch: LiveRun, n: int) -> None:
    """The messages come every 50 ms, and 300 ms later after a silence."""
    t_s = 100.0 + n * 0.05 + (0.3 if n >= 190 else 0.0)
    watch.take(LINES.encode(Arrival("/cmd_vel", t_s, "controller", n, t_s, "robot")))


def watched() -> LiveRun:
    """A run with one sudden loss and a silence of 350 ms until 9.8 s."""
    watch = LiveRun(threshold_ms=60.0, outputs=("/cmd_vel",))
    watch.start_s = 100.0
    watch.take(LINES.encode(LinkSample(100.0, 20.0)))
    watch.take(LINES.encode(PlacementChange(99.0, "cloud", 2, "LinkGood", "The link is good")))
    for n in range(192):
        message(watch, n)
    watch.take(LINES.encode(LinkSample(109.5, None)))
    watch.take(LINES.encode(PlacementChange(109.6, "robot", 3, "HeartbeatLost", "Gone", 92.0)))
    drive = translate.drive(109.9, state())
    assert drive is not None
    watch.take(json.dumps({"drive": dataclasses.asdict(drive)}))
    watch.take(json.dumps({"agents": {"round_trip_p50_ms": "12.5", "nodes": {"controller": "active"}}}))
    return watch


def test_a_switch_is_told_with_its_silence_once_that_is_known() -> None:
    watch = watched()
    watch.attend(110.0)
    assert watch.switches[0].gap_ms is None
    for n in range(192, 204):
        message(watch, n)
    watch.attend(110.2)
    gap_ms = watch.switches[0].gap_ms
    assert gap_ms is not None
    assert abs(gap_ms - 350.0) < 1.0
    texts = [event.text for event in watch.events()]
    assert any("92 ms after the last good heartbeat" in text for text in texts)
    assert texts[-1] == "longest silence around the switch at 9.6 s: 350 ms"


def test_the_link_is_told_when_it_changes() -> None:
    watch = watched()
    assert [event.text for event in watch.events() if "link is" in event.text and "the link" in event.text] == [
        "the link is good, 20 ms",
        "the link is cut",
    ]
    assert watch.link_word() == "cut"


def test_nothing_is_missing_once_every_output_was_heard() -> None:
    assert LiveRun(60.0, outputs=("/cmd_vel", "/arm")).missing() == ("/cmd_vel", "/arm")
    assert watched().missing() == ()


def test_the_agents_tell_their_round_trip_and_the_states_of_the_nodes() -> None:
    assert watched().round_trip_ms == 12.5
    assert watched().nodes == {"controller": "active"}


def test_lines_that_cannot_be_read_are_left_out() -> None:
    watch = watched()
    before = dataclasses.replace(watch)
    for line in ("", "{", "[]", "3", '{"kind": "moon"}', '{"drive": 3}', '{"agents": {}}', '{"drive": {}}'):
        watch.take(line)
    assert watch.placement == before.placement
    assert watch.drive == before.drive


def test_the_picture_shows_link_placement_corridor_and_switches() -> None:
    watch = watched()
    for n in range(192, 204):
        message(watch, n)
    watch.attend(110.3)
    text = io.StringIO()
    Console(file=text, width=110).print(picture(watch, 110.3, "title"))
    for expected in ("cut", "HeartbeatLost", "2.5 of 46 m", "0.60 m/s", "92 ms", "350 ms", "robot"):
        assert expected in text.getvalue()


def test_a_view_falls_silent_when_nobody_reads_any_more() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w", buffering=1) as broken:
        for view in (LineView(Terminal(file=broken)), LiveView(Terminal(file=broken, force_terminal=True), "title")):
            view.say("hello")
            view.show(watched(), 111.0)
            view.show(watched(), 112.0)
            view.close()
            view.say("bye")
