"""The console in a real browser over a real API server with two hundred robots, one of which has a real reporter."""

from __future__ import annotations

import contextlib
import http.client
import json
import re
import secrets
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser

from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL, read
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.headless import PHONE, Tab, browser
from tests.integration.operator_cluster import Place, eventually, walker
from tests.integration.operator_proxy import Answer, Asked, Proxy
from tests.unit.operator.reporter.running import Beating, Running
from tests.unit.operator.reporter.states import REPORT, text

pytestmark = pytest.mark.api
ROBOTS = 200
ONE = "walker-007"
REPORTING = 16
HOSTILE = '<img src=x onerror="alert(1)"><script>alert(2)</script>'
READERS = ["robotoffloads", "events"]


class Served:
    """`robot-offload console` as a process."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "robot_offload", "console", "--no-open", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line.startswith("Console: "):
            pytest.fail(f"it never said its address: {line}{self.process.communicate()[1]}")
        self.url = line.split()[1]
        self.port = urlsplit(self.url).port or 0

    def status(self, path: str, host: str = "") -> int:
        """What a request without a cookie is answered with."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{self.port}"})
            return connection.getresponse().status
        finally:
            connection.close()

    def stop(self) -> tuple[int, str]:
        """The exit code, and what it said on standard error."""
        self.process.send_signal(signal.SIGINT)
        _, errors = self.process.communicate(timeout=60)
        return self.process.returncode, errors


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as running:
        yield running


@pytest.fixture(scope="module")
def fleet(control_plane: ControlPlane) -> Iterator[Place]:
    """Two hundred RobotOffloads as an operator has left them; one carries hostile words."""
    namespace = control_plane.new_namespace(f"console-{secrets.token_hex(3)}")
    place = Place(control_plane, namespace)
    for number in range(ROBOTS):
        name = f"walker-{number:03}"
        made = place.create(ROBOT_OFFLOAD, walker(name))
        reason = HOSTILE if number == 103 else f"as robot {number} says"
        status = {
            "observedGeneration": made["metadata"]["generation"],
            "placement": "Cloud" if number % 3 else "Robot",
            "placementReason": "LinkGood" if number % 3 else "HeartbeatLost",
            "placementMessage": reason,
            "robot": {"connected": True, "since": "2026-11-22T10:00:00Z"},
            "certificates": {"robot": {"serial": "ab12", "notAfter": "2027-11-23T10:00:00Z"}},
            "endpoints": [{"purpose": "pulse", "protocol": "UDP", "host": "edge.example", "port": 30443}],
            "conditions": [
                {"type": "Ready", "status": "True", "reason": "Ready", "message": "",
                 "lastTransitionTime": "2026-11-23T10:00:00Z", "observedGeneration": 1},
            ],
        }  # fmt: skip
        place.patch(ROBOT_OFFLOAD, name, {"status": status}, "status")
    yield place
    control_plane.request("DELETE", f"/api/v1/namespaces/{namespace}")


def driving(number: int, **values: Any) -> str:
    """The n-th state of a robot that its cloud drives; `values` replace fields."""
    link = {"latency_ms": 12.0 + number % 5, "loss_share": 0.01}
    carried = [{"topic": "/scan", "bytes": 1000 * number, "age_ms": 9}]
    last = {"to": "cloud", "reason": "LinkGood", "ago_s": 40.0 + number / 5, "gap_ms": 61.5}
    robot = {**REPORT, "topics": {"/scan": [4 * number, 0, 4, 1]}, "changeover": last}
    return text(**{"written": str(number), "link": link, "carried": carried, "robot": robot, **values})


@pytest.fixture(scope="module")
def beating(
    control_plane: ControlPlane, fleet: Place, proxy: Proxy, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Beating]:
    """The reporter of one robot, behind the API server's proxy."""
    reporter = Running(tmp_path_factory.mktemp("reporter"), proxy.kubeconfig, fleet.namespace, ONE)
    for number in range(REPORTING):  # one reporter stands for many: a robot of the table is asked now and then
        proxy.services[f"{fleet.namespace}/walker-{number:03}-agent"] = reporter.url
    beats = Beating(reporter, driving)
    beats.start()
    yield beats
    beats.end()
    assert reporter.stop() == 0


@pytest.fixture(scope="module")
def served(fleet: Place, proxy: Proxy, beating: Beating) -> Iterator[Served]:
    console = Served("--kubeconfig", str(proxy.kubeconfig), "--namespace", fleet.namespace)
    yield console
    assert console.stop() == (0, "")


@pytest.fixture
def tab(served: Served, chromium: Browser) -> Iterator[Tab]:
    opened = Tab(chromium, served.url)
    yield opened
    opened.close()


def open_robot(tab: Tab, name: str = ONE) -> None:
    tab.page.get_by_label("Filter").fill(name)
    tab.page.get_by_role("link", name=name).click()
    tab.page.wait_for_selector("canvas")


def test_all_robots_are_there_filtered_and_their_words_are_only_words(tab: Tab) -> None:
    rows = tab.page.locator(".console-fleet tbody tr")
    tab.until(lambda: rows.count() == ROBOTS, "all rows")
    tab.says(f"{ROBOTS} robots")
    tab.says("✓ Ready")
    linked: set[str] = set()

    def all_seen() -> bool:
        # One after the other: a robot of the table is asked now and then, on a slow machine less often than it counts.
        texts = rows.all_inner_texts()
        linked.update(found[0] for text in texts if "● 1" in text and (found := re.search(r"walker-\d{3}", text)))
        return len(linked) >= REPORTING

    tab.until(all_seen, "the links of the robots that have a reporter")
    assert linked == {f"walker-{number:03}" for number in range(REPORTING)}
    tab.picture("console-fleet.png")
    tab.page.get_by_label("Filter").fill("onerror")
    tab.until(lambda: rows.count() == 1, "the one row with these words")
    assert HOSTILE in rows.first.inner_text()
    assert tab.complaints == []


def test_the_table_is_sorted_in_the_browser_at_once_and_stays_so_when_rows_change(tab: Tab, served: Served) -> None:
    rows = tab.page.locator(".console-fleet tbody tr")
    robot = tab.page.get_by_role("columnheader", name="Robot", exact=True)
    tab.until(lambda: rows.count() == ROBOTS, "all rows")
    served.process.send_signal(signal.SIGSTOP)  # the console is late: no answer of it is needed for an order
    try:
        robot.click()
        robot.click()
        tab.until(lambda: "walker-199" in rows.first.inner_text(), "the other order")
    finally:
        served.process.send_signal(signal.SIGCONT)
    reporting = rows.nth(ROBOTS - 1)
    assert "walker-000" in reporting.inner_text()
    before = reporting.inner_text()
    tab.until(lambda: reporting.inner_text() != before, "new numbers of the robot")
    assert "walker-000" in reporting.inner_text()
    assert "walker-199" in rows.first.inner_text()
    assert tab.complaints == []


def test_one_robot_is_live_and_can_be_scrolled_back(tab: Tab, beating: Beating) -> None:
    open_robot(tab)
    tab.says("☁ Cloud")
    tab.says("LinkGood: the link sustains the cloud")
    tab.says("loss 1.0%")
    tab.says("kB/s")  # of /scan
    for part in ("edge.example:30443/UDP", "ab12", "Ready", "● active", "The cloud acts."):
        tab.says(part)
    # What only the robot knows: the silence of the last switch, how old topics are, what is in flight.
    for part in ("62 ms", "9 ms", "1 executing, 2 waiting, 4 restarts", "3 open", "4 thinned, 1 unsent"):
        tab.says(part)
    held = {"site": "robot", "reason": "HoldDown", "message": "hold-down for another 2.0 s", "epoch": 13}
    beating.told = lambda number: driving(number, **held)
    tab.says("The robot's rule says HoldDown: hold-down for another 2.0 s")
    tab.says("within the bound of 60 ms")
    tab.says("▲ Robot")
    tab.says("changeover 13")
    beating.told = driving
    tab.says("☁ Cloud")
    tab.page.get_by_role("button", name="Replay the last minutes").click()
    tab.says("ours: the agents' own rule")
    tab.picture("console-robot.png")
    tab.page.keyboard.press("ArrowLeft")
    tab.until(lambda: "UTC" in tab.text("when"), "the moment that is scrolled back to")
    tab.page.keyboard.press("l")
    tab.until(lambda: tab.text("when") == "live", "live again")
    assert tab.complaints == []


def test_a_pin_changes_the_resource_for_two_tabs_and_one_with_an_end_names_it(
    tab: Tab, served: Served, chromium: Browser, fleet: Place
) -> None:
    other = Tab(chromium, served.url)
    for each in (tab, other):
        open_robot(each)
    tab.page.get_by_role("button", name="Pin to the robot").click()
    tab.says("held on the robot until it is taken back")
    eventually(lambda: fleet.roff(ONE)["spec"]["switching"].get("pin") == "Robot", "the pin")
    for each in (tab, other):
        button = each.page.get_by_role("button", name="Pin to the robot")
        each.until(button.is_disabled, "the button to know")
    end = "Robot 2026-11-23T00:00:00Z"
    fleet.patch(ROBOT_OFFLOAD, ONE, {"metadata": {"annotations": {PINNED_UNTIL: end}}})
    ended = {"status": {"pin": {"side": "Auto", "ended": end}}}
    fleet.patch(ROBOT_OFFLOAD, ONE, ended, "status")  # as the operator writes it
    for each in (tab, other):
        button = each.page.get_by_role("button", name="Pin to the robot")
        each.until(button.is_enabled, "the button to know that the pin has ended")
    other.page.get_by_role("button", name="Robot takes over now").click()
    eventually(
        lambda: fleet.roff(ONE)["metadata"]["annotations"][PINNED_UNTIL] not in ("", end), "the robot to take over"
    )
    assert read(fleet.roff(ONE)["metadata"]["annotations"][PINNED_UNTIL]).side == "Robot"
    tab.page.get_by_role("button", name="Let the rule decide").click()
    eventually(lambda: fleet.roff(ONE)["spec"]["switching"]["pin"] == "Auto", "the rule to decide")
    assert tab.complaints == other.complaints == []
    other.close()


def test_an_api_server_that_is_gone_is_said_and_comes_back(tab: Tab, proxy: Proxy) -> None:
    open_robot(tab)
    tab.says("☁ Cloud")
    proxy.fault = lambda asked: Answer.refusal(503, "ServiceUnavailable")
    proxy.cut_watches()
    tab.says("what is shown is old, trying again each second")
    proxy.fault = None
    tab.quiet("what is shown is old")
    tab.says("☁ Cloud")


def test_a_reporter_without_a_stream_is_asked_and_a_reporter_that_is_gone_is_said(
    tab: Tab, proxy: Proxy, fleet: Place, beating: Beating
) -> None:
    def older(asked: Asked) -> Answer | None:
        return Answer.refusal(404, "NotFound") if asked.path.endswith("/stream") else None

    proxy.fault = older
    proxy.cut_streams()
    open_robot(tab)
    tab.says("the reporter is older and offers no stream")
    tab.says("LinkGood: the link sustains the cloud")
    proxy.fault = None
    tab.quiet("the reporter is older")
    url = proxy.services.pop(f"{fleet.namespace}/{ONE}-agent")
    proxy.cut_streams()
    tab.says("shown is the resource's status")
    proxy.services[f"{fleet.namespace}/{ONE}-agent"] = url
    tab.quiet("shown is the resource's status")


def test_who_may_only_look_sees_why_the_buttons_do_nothing(
    chromium: Browser, control_plane: ControlPlane, fleet: Place
) -> None:
    kubectl: Kubectl = control_plane.kubectl(fleet.namespace)
    kubectl("create", "serviceaccount", "visitor")
    for resource in READERS:
        group = ".robotoffload.dev" if resource == "robotoffloads" else ""
        kubectl("create", "role", f"look-at-{resource}", "--verb=get,list,watch", f"--resource={resource}{group}")
        visitor = f"--serviceaccount={fleet.namespace}:visitor"
        kubectl("create", "rolebinding", f"visitor-{resource}", f"--role=look-at-{resource}", visitor)
    kubeconfig = control_plane.kubeconfig_of(fleet.namespace, "visitor")
    console = Served("--kubeconfig", str(kubeconfig), "--namespace", fleet.namespace)
    try:
        tab = Tab(chromium, console.url, PHONE, color_scheme="dark")
        open_robot(tab)
        tab.says(f"you may not patch robotoffloads in namespace {fleet.namespace}")
        tab.says("you may not get services/proxy")
        tab.says("LinkGood: as robot 7 says")
        assert tab.page.get_by_role("button", name="Pin to the robot").is_disabled()
        width = tab.page.evaluate("document.documentElement.scrollWidth")
        assert width <= PHONE["width"]
        assert tab.complaints == []
        tab.close()
    finally:
        code, errors = console.stop()
    assert (code, errors) == (0, "")


def test_without_the_token_or_under_another_name_nobody_gets_in(served: Served) -> None:
    token = urlsplit(served.url).query
    assert served.status(f"/?{token}") == 303
    assert served.status("/") == 403
    assert served.status("/?token=guessed") == 403
    assert served.status("/_nicegui/client.js") == 403
    assert served.status(f"/?{token}", host=f"attacker.example:{served.port}") == 403


def test_a_console_that_ends_is_said_in_the_tab(chromium: Browser, fleet: Place, proxy: Proxy) -> None:
    console = Served("--kubeconfig", str(proxy.kubeconfig), "--namespace", fleet.namespace)
    tab = Tab(chromium, console.url)
    tab.says(f"{ROBOTS} robots")
    assert console.stop() == (0, "")
    tab.says("Connection lost")
    tab.close()


def test_an_unreachable_cluster_is_said_on_the_page(chromium: Browser, tmp_path: Path) -> None:
    kubeconfig = tmp_path / "kubeconfig"
    cluster = {"name": "c", "cluster": {"server": "http://127.0.0.1:1"}}
    context = {"name": "c", "context": {"cluster": "c", "user": "u"}}
    users = [{"name": "u", "user": {"token": "t"}}]
    body = {"apiVersion": "v1", "kind": "Config", "clusters": [cluster], "users": users, "contexts": [context]}
    kubeconfig.write_text(json.dumps({**body, "current-context": "c"}))
    console = Served("--kubeconfig", str(kubeconfig), "--all-namespaces")
    with contextlib.closing(Tab(chromium, console.url)) as tab:
        tab.says("trying again each second")
    assert console.stop()[0] == 0
