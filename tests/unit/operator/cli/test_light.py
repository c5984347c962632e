"""The command line alone: what it does without the operator's libraries, and how it says which are missing."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[4]
SAMPLE = "manifests/samples/wheelchair.yaml"
HEAVY = ("kubernetes", "aiohttp", "structlog", "prometheus_client")
PROGRAM = f"""
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {HEAVY}:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Absent())
from robot_offload.cli.main import app
app(sys.argv[1:], prog_name="robot-offload")
"""


def run(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=ROOT)


@pytest.mark.parametrize(
    "words",
    [
        ("--version",),
        ("validate", SAMPLE),
        ("render", SAMPLE),
        ("render", "agent-config", SAMPLE, "--side", "robot"),
        ("dockerfile", "--help"),
        ("import", "--from", "tests/unit/operator/survey/wheelchair.json"),
    ],
    ids=" ".join,
)
def test_what_needs_no_cluster_needs_no_library_of_the_operator(words: tuple[str, ...]) -> None:
    done = run(*words)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def computed_s(*command: str) -> float:
    """Processor time of a program: the least of three, because a busy machine makes even that longer."""
    taken_s = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, capture_output=True, timeout=60, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(taken_s)


def test_the_version_costs_less_computing_than_six_starts_of_python() -> None:
    """Not in seconds, of which a slower machine needs more; two and a half starts when this was written."""
    program = str(Path(sys.executable).with_name("robot-offload"))
    assert computed_s(program, "--version") < 6 * computed_s(sys.executable, "-c", "")


@pytest.mark.parametrize("name", ["status", "bundle", "doctor"])
def test_what_asks_a_cluster_says_which_extra_brings_its_libraries(name: str) -> None:
    done = run(name, "--help")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("pip install 'robot-offload[cluster]'")
