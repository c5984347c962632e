"""Child processes never outlive the run, however it ends. Real processes, real signals."""

import os
import secrets
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robot_offload_lab.run import marked
from robot_offload_lab.run.processes import ProcessError, Processes, Program

PATIENCE_S = 60.0
SLEEPER = "import time; time.sleep(600)"
STUBBORN = (
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(600)"
)
# Leaves its group and session as a daemon does.
DAEMON = "import os, time; os.fork() or (os.setsid(), time.sleep(600)); time.sleep(600)"


@pytest.fixture
def run() -> Iterator[str]:
    """The name of a run, of which nothing is left after the test."""
    name = secrets.token_hex(8)
    yield name
    marked.end(name, grace_s=0.0)


def python(name: str, code: str, folder: Path) -> Program:
    return Program(name, (sys.executable, "-c", code), folder, dict(os.environ))


def eventually(condition: Callable[[], bool]) -> bool:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline_s:
        time.sleep(0.02)
    return condition()


def test_leaving_ends_every_process_also_stubborn_ones_and_daemons(tmp_path: Path, run: str) -> None:
    with Processes(run, tmp_path, tmp_path / "gone") as processes:
        for name, code in (("sleeper", SLEEPER), ("stubborn", STUBBORN), ("daemon", DAEMON)):
            processes.start(python(name, code, tmp_path))
        assert eventually(lambda: len(marked.find(run)) == 4 and "up" in processes.log("stubborn").read_text())
        assert processes.first_ended() is None
    assert marked.find(run) == ()


def test_a_process_is_named_with_its_program_while_it_lives(tmp_path: Path, run: str) -> None:
    with Processes(run, tmp_path, tmp_path / "gone") as processes:
        processes.start(python("sleeper", SLEEPER, tmp_path))
        assert eventually(lambda: any(name.endswith(f"-c {SLEEPER}") for name in marked.named(marked.find(run))))
        pids = marked.find(run)
    assert marked.named(pids) == [f"{pid}: has ended" for pid in pids]


def test_an_exception_ends_every_process(tmp_path: Path, run: str) -> None:
    def fail() -> None:
        with Processes(run, tmp_path, tmp_path / "gone") as processes:
            processes.start(python("sleeper", SLEEPER, tmp_path))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert marked.find(run) == ()


def test_a_process_that_ends_is_told_with_its_code_and_last_lines(tmp_path: Path, run: str) -> None:
    with Processes(run, tmp_path, tmp_path / "gone") as processes:
        processes.start(python("short", "print('first'); print('last'); raise SystemExit(3)", tmp_path))
        assert eventually(lambda: processes.first_ended() is not None)
        ended = processes.first_ended()
        assert ended is not None
        assert ended.describe() == "short ended with exit code 3"
        assert processes.last_lines("short") == ("first", "last")


def test_a_process_that_a_signal_ended_is_told_with_the_signal(tmp_path: Path, run: str) -> None:
    with Processes(run, tmp_path, tmp_path / "gone") as processes:
        child = processes.start(python("killed", SLEEPER, tmp_path))
        child.kill()
        assert eventually(lambda: processes.first_ended() is not None)
        ended = processes.first_ended()
        assert ended is not None
        assert ended.describe() == "killed ended by signal SIGKILL"


def test_a_program_that_does_not_exist_is_an_error_that_names_it(tmp_path: Path, run: str) -> None:
    with Processes(run, tmp_path, tmp_path / "gone") as processes, pytest.raises(ProcessError, match="no-such-program"):
        processes.start(Program("missing", ("no-such-program",), tmp_path, dict(os.environ)))


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_the_death_of_the_run_itself_leaves_no_process_and_no_temporary_folder(
    tmp_path: Path, run: str, how: signal.Signals
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    parent = f"""
        import os, sys, time
        from pathlib import Path
        from robot_offload_lab.run.processes import Processes, Program
        with Processes({run!r}, Path({str(tmp_path)!r}), Path({str(temporary)!r})) as processes:
            for name, code in (("stubborn", {STUBBORN!r}), ("daemon", {DAEMON!r})):
                command = (sys.executable, "-c", code)
                processes.start(Program(name, command, Path({str(tmp_path)!r}), dict(os.environ)))
            time.sleep(600)
    """
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(parent)]) as child:
        try:
            assert eventually(lambda: len(marked.find(run)) == 3)
            child.send_signal(how)
            child.wait(PATIENCE_S)
        finally:
            child.kill()
    assert eventually(lambda: marked.find(run) == ())
    assert eventually(lambda: not temporary.exists())
