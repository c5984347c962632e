"""The parent of an agent's processes: starts, starts again, waits longer for what keeps dying, and ends everything."""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.runtime.supervisor import Supervisor

PATIENCE_S = 60.0


class Family:
    """Supervisors started by one test, with their children."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = dict(os.environ)
        self.started: list[subprocess.Popen[bytes]] = []

    def start(
        self, *words: str, folder: Path | None = None, inside: Sequence[str] = (), hung_s: float | None = None
    ) -> subprocess.Popen[bytes]:
        """Starts one; a child `one` that is silent for `hung_s` hangs (None: for long)."""
        module = "tests.unit.agent.runtime.supervised"
        command = [*inside, sys.executable, "-m", module, str(folder or self.folder), self.folder.name, *words]
        patience = {} if hung_s is None else {"ONE_HUNG_S": str(hung_s)}
        with (self.folder / "log").open("ab") as log:
            self.started.append(
                subprocess.Popen(
                    command, stdout=log, stderr=log, start_new_session=True, env=self.environment | patience
                )
            )
        return self.started[-1]

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text()

    def pid(self, name: str) -> int:
        """The number of a child that runs, which the supervisor writes down a moment after the start."""
        path = self.folder / f"{name}.pid"
        assert until(lambda: path.exists() and path.read_text())
        return int(path.read_text())

    def heard(self, name: str) -> str:
        path = self.folder / f"{name}.heard"
        return path.read_text() if path.exists() else ""

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
    os.kill(dead, signal.SIGKILL)
    assert until(lambda: family.lives("one") == 2)
    assert family.pid("two") == other
    assert re.search(r"one ended with signal SIGKILL, starting it again in 0\.\d\d s", family.log)


def test_a_child_that_keeps_dying_is_started_less_and_less_often(family: Family) -> None:
    family.start("one=die", "two=sleep")
    pauses = re.compile(r"one ended with .*, starting it again in ([\d.]+) s")
    assert until(lambda: len(pauses.findall(family.log)) >= 5)
    assert pauses.findall(family.log)[:5] == ["0.00", "0.05", "0.10", "0.20", "0.40"]
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
    assert not list(family.folder.glob("*.pid"))


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


def test_a_process_that_only_has_the_number_and_the_name_of_a_stray_is_left_alone(
    family: Family, tmp_path: Path
) -> None:
    """As one of another robot's agent on this host has."""
    sleep = shutil.which("sleep")
    assert sleep is not None
    program = shutil.copy(sleep, tmp_path / "ro-test-one")
    with subprocess.Popen([program, "60"]) as somebody:
        assert until(lambda: Path(f"/proc/{somebody.pid}/comm").read_text().strip() == "ro-test-one")
        (family.folder / "one.pid").write_text(str(somebody.pid))
        family.start("one=sleep")
        assert until(lambda: family.lives("one"))
        assert somebody.poll() is None
        somebody.kill()


def test_a_second_agent_of_the_identity_is_refused_with_the_number_of_the_first_whatever_its_folder(
    family: Family,
) -> None:
    first = family.start("one=sleep")
    assert until(lambda: family.lives("one"))
    assert family.start("one=sleep", folder=family.folder / "other").wait(PATIENCE_S) == 3
    assert f"runs on this host already: it is process {first.pid}" in family.log
    assert family.lives("one") == 1
    assert not (family.folder / "other").exists()


def test_an_agent_in_a_container_on_the_hosts_network_is_refused_as_well(family: Family) -> None:
    inside = ["unshare", "--pid", "--mount", "--ipc", "--uts", "--fork", "--mount-proc"]
    family.start("one=sleep")
    assert until(lambda: family.lives("one"))
    assert family.start("one=sleep", folder=family.folder / "other", inside=inside).wait(PATIENCE_S) == 3
    assert "it is in a container, or of another user" in family.log


def test_a_name_that_the_system_does_not_allow_is_no_second_agent(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be taken on this host"):
        Supervisor(tmp_path, "ro-test", [], "x" * 200).run()


def test_what_an_agent_left_in_another_folder_is_ended_by_the_next_one(family: Family) -> None:
    first = family.start("one=sleep")
    assert until(lambda: family.lives("one"))
    stray = family.pid("one")
    first.kill()
    first.wait(PATIENCE_S)
    family.start("one=sleep", folder=family.folder / "other")
    assert until((family.folder / "other" / "one.lives").exists)
    assert not alive(stray)


@pytest.mark.parametrize("how", ["stopped", "hang", "half"])
def test_a_child_that_hangs_is_killed_and_started_again_and_the_others_are_left_alone(family: Family, how: str) -> None:
    family.start(f"one={'sleep' if how == 'stopped' else how}", "control=control", hung_s=2.0)
    assert until(lambda: family.lives("one") and family.lives("control"))
    other = family.pid("control")
    if how == "stopped":
        os.kill(family.pid("one"), signal.SIGSTOP)
    assert until(lambda: family.lives("one") >= 2)
    assert "Process one hangs (no sign of life for 2 s), ending it" in family.log
    assert until(lambda: re.search(r"\('one', (\d+), \1, 0\), \('control', 0, 0, 0\)", family.heard("control")))
    assert family.pid("control") == other


def test_a_child_that_another_one_misses_is_ended_sooner_if_it_shows_no_life(family: Family) -> None:
    family.start("one=hang", "two=miss")
    assert until(lambda: family.lives("one") >= 2)
    assert "Process one hangs (no sign of life for 1.4 s), ending it" in family.log
    assert family.lives("two") == 1


def test_a_child_that_lives_is_left_alone_although_another_one_misses_it(family: Family) -> None:
    family.start("one=sleep", "two=miss")
    assert until(lambda: family.lives("one") and family.lives("two"))
    time.sleep(3.0)
    assert "Process one hangs" not in family.log
    assert family.lives("one") == 1


def test_deaths_for_a_broken_invariant_are_counted_beyond_the_life_of_the_process(family: Family) -> None:
    family.start("one=break", "two=die", "control=control")
    pattern = r"\('one', (\d+), 0, \1\), \('two', [1-9]\d*, 0, 0\), \('control', 0, 0, 0\)"
    assert until(lambda: re.search(pattern, family.heard("control")))
    assert "machine: what must hold; after 'an event'" in family.log


def test_a_supervisor_that_was_stopped_itself_takes_nobody_for_hanging(family: Family) -> None:
    process = family.start("one=sleep", "two=sleep", hung_s=4.0)
    assert until(lambda: family.lives("one") and family.lives("two"))
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(6.0)
    os.kill(process.pid, signal.SIGCONT)
    time.sleep(1.0)
    assert (family.lives("one"), family.lives("two")) == (1, 1)


def test_systemd_hears_that_the_agent_is_ready_lives_and_stops(family: Family) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(family.folder / "notify"))
        manager.settimeout(PATIENCE_S)
        family.environment |= {"NOTIFY_SOCKET": str(family.folder / "notify"), "WATCHDOG_USEC": "1500000"}
        process = family.start("one=sleep")
        assert manager.recv(1000).startswith(b"READY=1\n")
        assert [manager.recv(1000) for _ in range(3)] == [b"WATCHDOG=1"] * 3
        process.terminate()
        while (said := manager.recv(1000)) == b"WATCHDOG=1":
            pass
        assert said == b"STOPPING=1"


def test_a_folder_that_others_could_exchange_things_in_is_refused(family: Family) -> None:
    theirs, open_to_all = family.folder / "theirs", family.folder / "open"
    theirs.mkdir()
    os.chown(theirs, 12345, 12345)
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    for folder, why in ((theirs, "belongs to user 12345"), (open_to_all, "mode 0777")):
        for chosen in (folder, folder / "below"):
            assert family.start("one=sleep", folder=chosen).wait(PATIENCE_S) == 2
            assert why in family.log
    open_to_all.chmod(0o1777)
    family.start("one=sleep", folder=open_to_all / "below")
    assert until((open_to_all / "below" / "one.lives").exists)


def test_a_full_disk_under_the_runtime_folder_ends_nothing(family: Family) -> None:
    full = family.folder / "full"
    full.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k,mode=700", "tmpfs", str(full)], check=True)
    try:
        family.start("one=sleep", "two=sleep", folder=full)
        assert until(lambda: (full / "one.lives").exists() and (full / "two.lives").exists())
        pids = [full / "one.pid", full / "two.pid"]
        assert until(lambda: all(path.exists() and path.read_text() for path in pids))
        one = int(pids[0].read_text())
        (full / "one.pid").unlink()  # else its page is free for the next one
        with contextlib.suppress(OSError), (full / "much").open("wb", buffering=0) as much:
            while True:
                much.write(bytes(4096))
        os.kill(one, signal.SIGKILL)
        assert until(lambda: "one.pid cannot be written: No space left on device" in family.log)
        assert "Traceback" not in family.log
    finally:
        family.close()
        subprocess.run(["umount", "-l", str(full)], check=True)


def test_a_folder_that_cannot_be_used_is_named_with_its_parameter(family: Family) -> None:
    (family.folder / "file").write_text("")
    long = family.folder / ("x" * 120)
    for folder in (family.folder / "file", long):
        command = [sys.executable, "-m", "tests.unit.agent.runtime.supervised", str(folder), "nobody", "one=sleep"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert done.returncode == 2
        assert "parameter runtime_dir" in done.stderr
