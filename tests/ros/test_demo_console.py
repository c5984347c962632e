"""`robot-offload demo --console` and its recording in a real browser: real agents, real nodes, an emulated link."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.headless import Tab, browser

ROOT = Path(__file__).parents[2]
TALKER = ROOT / "examples" / "talker" / "robotoffload.yaml"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as running:
        yield running


def started(*arguments: str) -> tuple[subprocess.Popen[str], str]:
    """A command that serves a console, and the console's address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "robot_offload", *arguments], cwd=ROOT, text=True, env=dict(os.environ),
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    assert process.stdout is not None
    said = []
    for line in process.stdout:
        said.append(line)
        if line.startswith("Console: "):
            return process, line.split()[1]
    pytest.fail(f"it never said its address: {''.join(said)}")


def stop(demo: subprocess.Popen[str]) -> None:
    """Ends a demo: with the first Ctrl-C the run ends where it still goes on, with the next one the pages."""
    for _ in range(2):
        demo.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            demo.communicate(timeout=60)
            return
    os.killpg(demo.pid, signal.SIGKILL)
    demo.communicate()


def changes(tab: Tab) -> int:
    """How many changeovers the page lists."""
    return tab.page.locator(".mark-Changeovers tbody tr").count()


def test_a_demo_is_seen_while_it_runs_and_its_recording_afterwards(chromium: Browser, tmp_path: Path) -> None:
    outages = ("--duration", "600", "--outage", "2/6", "--slow", "none")
    options = ("--realtime", *outages, "--no-ui", "--console", "--out", str(tmp_path))
    demo, address = started("demo", str(TALKER), *options)
    try:
        tab = Tab(chromium, address)
        tab.page.get_by_role("link", name="talker").click()
        tab.page.wait_for_selector("canvas")
        tab.says("● active")
        tab.says("/chatter")
        tab.until(lambda: changes(tab) >= 2, "changes to the cloud and back")
        tab.says("HeartbeatLost")
        pin = tab.page.get_by_role("button", name="Pin to the robot")
        tab.until(pin.is_enabled, "the button")
        pin.click()
        tab.says("held on the robot until it is taken back")
        tab.says("PinnedToRobot")  # the robot's own word: the wish has gone through both agents
        tab.page.get_by_role("button", name="Let the rule decide").click()
        tab.says("the rule decides again")
        tab.says("☁ Cloud")  # after the outage: with its loss these are two changes while the recording goes on
        demo.send_signal(signal.SIGINT)  # the run ends in order, the pages stay
        assert demo.stdout is not None
        for line in demo.stdout:
            if "the console shows it until Ctrl-C" in line:
                break
        tab.says("old")  # nothing comes any more, and the page says so
        assert tab.complaints == []
        tab.close()
    finally:
        stop(demo)
    assert demo.returncode in (0, 1)  # 1: a promise was broken, as on a machine that stood still
    recorded, address = started("console", str(tmp_path), "--no-open")
    try:
        tab = Tab(chromium, address)
        tab.page.get_by_role("link", name="talker").click()
        tab.page.wait_for_selector("canvas")
        tab.says("this is a recording: nothing can be changed in it")
        tab.until(lambda: changes(tab) >= 2, "the changes of the run")
        end = tab.text("line")
        tab.page.keyboard.press("ArrowLeft")
        tab.until(lambda: tab.text("when").endswith(" s"), "the moment that is scrolled back to")
        tab.page.get_by_role("button", name="Replay the last minutes").click()
        tab.says("optimum")
        assert end
        assert tab.complaints == []
        tab.close()
    finally:
        recorded.send_signal(signal.SIGTERM)
        recorded.communicate(timeout=60)
    assert recorded.returncode == 0
