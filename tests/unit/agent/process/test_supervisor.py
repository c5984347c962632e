"""The parent of an agent's processes: starts, starts again, waits longer for what keeps dying, and ends everything."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

PATIENCE_S = 20.0


class Family:
    """Supervisors started by one test, with their children."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.started: list[subprocess.Popen[bytes]] = []

    def start(self, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "tests.unit.agent.process.supervised", str(self.folder), *words]
        with (self.folder / "log").open("ab") as log:
            self.started.append(subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True))
        return self.started[-1]

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text()

    def pid(self, name: str) -> int:
        try:
            return int((self.folder / f"{name}.pid").read_text())
        except (OSError, ValueError):
            return 0

    def lives(self, name: str) -> int:
        path = self.folder / f"{name}.lives"
        return path.stat().st_size if path.exists() else 0

    def close(self) -> None:
        for process in self.started:
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
            process.wait(PATIENCE_S)


@pytest.fixture
def family() -> Iterator[Family]:
    with tempfile.TemporaryDirectory(prefix="ro-") as folder:
        found = Family(Path(folder))
        yield found
        found.close()


def until(condition: Callable[[], object], patience_s: float = PATIENCE_S) -> bool:
    end_s = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.01)
    return True


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_children_are_named_and_ended_with_the_supervisor(family: Family) -> None:
    process = family.start("one=sleep", "two=sleep")
    assert until(lambda: family.lives("one") and family.lives("two"))
    pids = [family.pid("one"), family.pid("two")]
    assert Path(f"/proc/{pids[0]}/comm").read_text().strip() == "ro-test-one"
    process.terminate()
    assert process.wait(PATIENCE_S) == 0
    assert not any(map(alive, pids))
    assert not list(family.folder.glob("*.pid"))
    assert not list(family.folder.glob("*.sock"))


def test_a_child_that_is_killed_is_back_and_the_others_are_left_alone(family: Family) -> None:
    family.start("one=sleep", "two=sleep")
    assert until(lambda: family.lives("one") and family.lives("two"))
    dead, other = family.pid("one"), family.pid("two")
    at_s = time.monotonic()
    os.kill(dead, signal.SIGKILL)
    assert until(lambda: family.lives("one") == 2)
    assert time.monotonic() - at_s < 2.0
    assert family.pid("two") == other
    assert "ended with signal SIGKILL" in family.log


def test_a_child_that_keeps_dying_is_started_less_and_less_often(family: Family) -> None:
    family.start("one=die", "two=sleep")
    assert until(lambda: "starting it again in 0.40 s" in family.log)
    assert family.lives("one") <= 6
    assert alive(family.pid("two"))


def test_a_child_that_ignores_the_end_is_killed_after_a_grace(family: Family) -> None:
    process = family.start("one=deaf")
    assert until(lambda: family.lives("one"))
    pid = family.pid("one")
    process.terminate()
    assert process.wait(PATIENCE_S) == 0
    assert not alive(pid)


def test_a_stopped_child_is_ended_as_well(family: Family) -> None:
    process = family.start("one=sleep")
    assert until(lambda: family.lives("one"))
    pid = family.pid("one")
    os.kill(pid, signal.SIGSTOP)
    process.terminate()
    assert process.wait(PATIENCE_S) == 0
    assert not alive(pid)


def test_a_message_for_a_person_at_the_start_ends_everything_with_its_exit_code(family: Family) -> None:
    process = family.start("one=error", "two=sleep")
    assert process.wait(PATIENCE_S) == 4
    assert "one: one cannot start: move the other one away" in family.log
    assert until(lambda: not alive(family.pid("two")))


def test_the_same_message_from_a_child_in_its_second_life_ends_nothing(family: Family) -> None:
    process = family.start("one=late", "two=sleep")
    assert until(lambda: family.lives("one") > 2)
    assert process.poll() is None
    assert "one cannot start" in family.log


def test_a_second_supervisor_of_the_same_folder_is_refused_and_the_first_goes_on(family: Family) -> None:
    family.start("one=sleep")
    assert until(lambda: family.lives("one"))
    pid = family.pid("one")
    assert family.start("one=sleep").wait(PATIENCE_S) == 3
    assert "stop it first" in family.log
    assert alive(pid)
    assert family.pid("one") == pid


def test_children_outlive_their_supervisor_and_the_next_one_ends_them_and_starts_anew(family: Family) -> None:
    first = family.start("one=sleep")
    assert until(lambda: family.lives("one") and family.pid("one"))
    stray = family.pid("one")
    first.kill()
    first.wait(PATIENCE_S)
    assert alive(stray)
    (family.folder / "collector.memory").write_text("of the dead one")
    family.start("one=sleep")
    assert until(lambda: family.lives("one") == 2)
    assert until(lambda: not alive(stray))
    assert not (family.folder / "collector.memory").exists()


def test_a_process_that_only_has_the_number_of_a_stray_is_left_alone(family: Family) -> None:
    with subprocess.Popen(["sleep", "60"]) as somebody:
        (family.folder / "one.pid").write_text(str(somebody.pid))
        (family.folder / "two.pid").write_text("no number")
        family.start("one=sleep")
        assert until(lambda: family.lives("one"))
        assert somebody.poll() is None
        somebody.kill()


def test_a_folder_that_cannot_be_used_is_named_with_its_parameter(family: Family) -> None:
    (family.folder / "file").write_text("")
    long = family.folder / ("x" * 120)
    for folder in (family.folder / "file", long):
        command = [sys.executable, "-m", "tests.unit.agent.process.supervised", str(folder), "one=sleep"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert done.returncode == 2
        assert "parameter runtime_dir" in done.stderr
