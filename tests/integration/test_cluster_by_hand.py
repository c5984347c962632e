"""A cluster with nodes that ends otherwise than planned: Ctrl-C, kill -9; and what is not ours."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robot_offload_lab.cluster import netns, ownership, sysctls, wire_accuracy
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import NUMBERS, Layout
from robot_offload_lab.cluster.preflight import preflight

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(900)]

ROOT = Path(__file__).parents[2]
A_RUN = """
import sys
from robot_offload_lab.cluster.cluster import Cluster
with Cluster.up(nodes=1, number=int(sys.argv[1]), say=print) as cluster:
    cluster.robot("robot").start(["sleep", "1000"])
    print("here", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def layout() -> Iterator[Layout]:
    """A number that nobody uses; whatever a failed test left there goes."""
    if why := preflight():
        pytest.skip(why)
    known = ownership.known()
    free = next((Layout(each) for each in reversed(NUMBERS) if Layout(each) not in known), None)
    if free is None:
        pytest.skip("all numbers of clusters are taken")
    yield free
    ownership.remove(free)


class Run:
    """A process that starts a cluster, on the command line or as a test run does."""

    def __init__(self, home: Path, *arguments: str) -> None:
        environment = {**os.environ, "XDG_STATE_HOME": str(home), "TMPDIR": str(home)}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [sys.executable, *arguments], cwd=ROOT, env=environment, stdin=pipe, stdout=pipe, stderr=pipe, text=True
        )

    def told(self, words: str) -> str:
        """What it prints until a line with these words."""
        assert self._process.stdout is not None
        lines = []
        for line in self._process.stdout:
            lines.append(line)
            if words in line:
                return "".join(lines)
        pytest.fail(f"it ended: {''.join(lines)}{self._process.communicate()[1]}")

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self) -> tuple[str, str]:
        return self._process.communicate()


def by_hand(home: Path, *arguments: str) -> Run:
    return Run(home, "-m", "robot_offload_lab.cluster", "--name", "by-hand", *arguments)


def soon(question: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 120
    while not question():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def test_a_run_that_is_killed_leaves_no_process_and_down_removes_the_rest(layout: Layout, tmp_path: Path) -> None:
    run = Run(tmp_path, "-c", A_RUN, str(layout.number))
    run.told("here")
    run.signal(signal.SIGKILL)
    run.end()
    assert soon(lambda: ownership.leftovers(layout).processes == 0)  # the kernel kills them; nobody else does
    assert ownership.leftovers(layout).netns > 0
    assert f"also removed cluster {layout.number}, left by a test run" in by_hand(tmp_path, "down").end()[1]
    assert not ownership.leftovers(layout)


def test_a_run_that_ends_takes_its_cluster_along(layout: Layout, tmp_path: Path) -> None:
    run = Run(tmp_path, "-c", A_RUN, str(layout.number))
    run.told("here")
    assert run.end()[1] == ""
    assert not ownership.leftovers(layout)


def test_by_hand_from_up_to_down(layout: Layout, tmp_path: Path) -> None:
    number = str(layout.number)
    out, said = by_hand(tmp_path, "up", "--nodes", "1", "--number", number).end()
    assert f"export KUBECONFIG={layout.plane}/kubeconfig" in out, said
    assert "API server ready after" in said
    assert "node1" in by_hand(tmp_path, "kubectl", "get", "nodes").end()[0]
    assert f"cluster {number}: in use" in by_hand(tmp_path, "status").end()[0]
    assert "running already" in by_hand(tmp_path, "up", "--nodes", "1").end()[1]

    assert "has the address" in by_hand(tmp_path, "robot", "car", "add").end()[0]
    assert "'delay_ms': 5.0" in by_hand(tmp_path, "robot", "car", "wire", "delay_ms=5", "cut=both").end()[0]
    assert "'cut': None" in by_hand(tmp_path, "robot", "car", "wire", "cut=").end()[0]
    assert "is not a setting of a wire" in by_hand(tmp_path, "robot", "car", "wire", "speed=5").end()[1]
    assert "192.168." in by_hand(tmp_path, "robot", "car", "run", "ip", "-br", "address").end()[0]

    with pytest.raises(ClusterError, match="started by hand"):
        ownership.claim(layout.number, None)
    assert f"cluster {number} removed\n" in by_hand(tmp_path, "down").end()[1]
    assert not ownership.leftovers(layout)


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_up_that_is_broken_off_leaves_nothing_after_down(
    layout: Layout, tmp_path: Path, ending: signal.Signals
) -> None:
    run = by_hand(tmp_path, "up", "--nodes", "1", "--number", str(layout.number))
    assert soon(lambda: netns.exists(layout.netns("node1")))
    run.signal(ending)
    said = run.end()[1]
    if ending == signal.SIGINT:
        assert "nothing is left" in said
    else:
        assert ownership.leftovers(layout).processes > 0  # it was to outlive the command
        assert f"cluster {layout.number} removed" in by_hand(tmp_path, "down").end()[1]
    assert not ownership.leftovers(layout)


def test_the_wire_is_measured_without_a_cluster(
    layout: Layout, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(wire_accuracy, "COUNT", 10)
    assert wire_accuracy.main() == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if line.startswith("| 10 ms")]
    assert [row[1] for row in rows] == ["yes", "no"]
    assert all(float(row[3].removesuffix(" ms")) >= 20 for row in rows)


def test_what_is_not_ours_is_not_touched(layout: Layout) -> None:
    strange = layout.netns("strange")
    netns.make(strange)
    try:
        with pytest.raises(ClusterError, match=f"no cluster of ours made them: {strange}"):
            ownership.claim(layout.number, None)
        assert netns.exists(strange)
    finally:
        netns.remove(strange)


def test_the_last_cluster_puts_the_machines_settings_back(layout: Layout) -> None:
    if ownership.known():
        pytest.skip("another cluster is there: the last one puts them back")
    setting = Path("/proc/sys/vm/panic_on_oom")
    before = setting.read_text()
    found = {name: (Path("/proc/sys") / name).read_text() for name in sysctls.RAISED}
    _, lock = ownership.claim(layout.number, None)
    with lock:
        setting.write_text("1" if before.strip() == "0" else "0")  # as a kubelet does
        assert "vm/panic_on_oom" in sysctls.changed()  # beside what was raised, where that was needed
        ownership.remove(layout)
    assert setting.read_text() == before
    assert {name: (Path("/proc/sys") / name).read_text() for name in found} == found
    assert not ownership.leftovers(layout)
