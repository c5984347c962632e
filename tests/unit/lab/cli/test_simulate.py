"""`robot-offload simulate` as a user runs it: exit codes, standard output, standard error, files."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.cli.main import app
from tests.unit.lab.replay.cases import ROOT

CORRIDOR = ROOT / "examples" / "traces" / "corridor-wifi.txt"
YARD = ROOT / "examples" / "traces" / "yard-4g.csv"


@dataclass(frozen=True)
class Done:
    returncode: int
    stdout: str
    stderr: str


def run(*arguments: str | Path, folder: Path = ROOT) -> Done:
    """In this process, because a new one spends most of its time on imports."""
    with contextlib.chdir(folder):
        result = CliRunner().invoke(app, ["simulate", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Done(result.exit_code, result.stdout, result.stderr)


def test_the_command_runs_as_a_process_of_its_own() -> None:
    command = [sys.executable, "-c", "from robot_offload.cli.main import app; app(prog_name='robot-offload')"]
    done = subprocess.run(
        [*command, "simulate", "--trace", CORRIDOR, "--json"], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0
    assert [recording["trace"] for recording in json.loads(done.stdout)["recordings"]] == [CORRIDOR.name]


def test_one_policy_is_told_as_a_table_and_as_strips() -> None:
    done = run("--trace", CORRIDOR, "--tolerance", "20ms")
    assert (done.returncode, done.stderr) == (0, "")
    first, *rest = done.stdout.splitlines()
    assert first.startswith("corridor-wifi.txt: 60 s, good enough up to 50 ms (tolerance 20 ms), 97")
    rows = [line.split()[0] for line in rest if line.split()[:1] in (["ours"], ["best"], ["optimum"])]
    assert rows == ["ours", "best", "optimum"]
    assert sum(line.startswith("in cloud") for line in rest) == 2


def test_the_json_holds_every_figure_and_every_change() -> None:
    done = run("--trace", f"{YARD}@100ms", "--policy", "thesis", "--json")
    assert done.returncode == 0
    results = json.loads(done.stdout)
    (recording,) = results["recordings"]
    assert (recording["trace"], recording["duration_s"], recording["limit_ms"]) == ("yard-4g.csv", 180.0, 130.0)
    thesis, optimum = recording["policies"]
    figures = {
        "exposed_s", "wasted_s", "switches", "cloud_pct", "cost", "J", "optimum", "ratio", "best_fixed",
        "ratio_best_fixed",
    }  # fmt: skip
    assert set(thesis) == {"policy", "unclamped", "changes"} | figures
    assert set(thesis["unclamped"]) == figures
    assert {name: results[name] for name in figures} == {name: thesis[name] for name in figures}
    assert thesis["ratio_best_fixed"] == pytest.approx(thesis["cost"] / thesis["best_fixed"], abs=0.001)
    assert thesis["unclamped"]["optimum"] <= optimum["cost"]
    assert thesis["cost"] == pytest.approx(
        10 * thesis["exposed_s"] + thesis["wasted_s"] + 0.5 * thesis["switches"], abs=0.01
    )
    assert thesis["ratio"] == pytest.approx(thesis["cost"] / optimum["cost"], abs=0.001)
    assert len(thesis["changes"]) == thesis["switches"]
    assert thesis["changes"][0]["site"] == "cloud"
    assert all(change["reason"] and change["message"] for change in thesis["changes"])


def test_all_policies_are_compared_and_written_into_a_folder(tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    done = run("--trace", f"{CORRIDOR}@20ms", "--trace", f"{YARD}@100ms", "--compare", "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == f"Written: {out}"
    results = json.loads((out / "results.json").read_text())
    names = [[policy["policy"] for policy in recording["policies"]] for recording in results["recordings"]]
    assert names == [["ours", "thesis", "dwell", "mean", "robot", "cloud", "optimum"]] * 2
    assert (out / "placement.png").read_bytes().startswith(b"\x89PNG")


def test_prices_can_be_set() -> None:
    done = run("--trace", CORRIDOR, "--policy", "cloud", "--weights", "0.001/1/0.25", "--json")
    (recording,) = json.loads(done.stdout)["recordings"]
    assert recording["weights"] == {"exposed_per_s": 0.001, "wasted_per_s": 1.0, "switch": 0.25}
    assert recording["policies"][0]["unclamped"]["cost"] == pytest.approx(0.25, abs=0.01)


def test_figures_are_searched_and_told_for_the_recording_left_out() -> None:
    done = run("--trace", f"{CORRIDOR}@20ms", "--trace", f"{YARD}@100ms", "--tune", "--json")
    assert done.returncode == 0
    assert "best other rule" in done.stderr
    reports = json.loads(done.stdout)["tuning"]
    assert [(report["trace"], report["trained_on"]) for report in reports] == [
        ("corridor-wifi.txt", ["yard-4g.csv"]), ("yard-4g.csv", ["corridor-wifi.txt"])
    ]  # fmt: skip


def test_figures_that_were_searched_are_reported_on_other_recordings_only() -> None:
    done = run("--trace", f"{CORRIDOR}@20ms", "--tune", "--report-on", f"{YARD}@100ms", "--json")
    assert done.returncode == 0
    (report,) = json.loads(done.stdout)["tuning"]
    assert (report["trace"], report["trained_on"]) == ("yard-4g.csv", ["corridor-wifi.txt"])


def test_a_copy_under_another_name_is_the_same_recording(tmp_path: Path) -> None:
    copy = tmp_path / "other.txt"
    copy.write_bytes(CORRIDOR.read_bytes())
    done = run("--trace", CORRIDOR, "--tune", "--report-on", copy)
    assert done.returncode == 2
    assert done.stderr.startswith(f"--report-on {copy}: that is the recording {CORRIDOR}, which is searched")


@pytest.mark.parametrize("missing", ["numpy", "matplotlib"])
def test_without_the_extra_for_plots_the_command_says_what_to_install(missing: str) -> None:
    code = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "from robot_offload.cli.main import app; app(prog_name='robot-offload')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "simulate", "--trace", CORRIDOR],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert "pip install 'robot-offload[plots]'" in done.stderr


def test_a_file_may_have_an_at_sign_in_its_name(tmp_path: Path) -> None:
    odd = tmp_path / "link@20ms"
    odd.write_text("10\n" * 100)
    done = run("--trace", odd, "--json")
    assert json.loads(done.stdout)["recordings"][0]["tolerance_ms"] == 30.0


def test_an_own_policy_is_found_in_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "policy_of_my_own.py").write_text(
        "class Always:\n"
        "    def heard(self, sent_s, arrived_s): pass\n"
        "    def place(self, now_s): return 'cloud'\n"
        "def make(settings): return Always()\n"
    )
    done = run("--trace", CORRIDOR, "--policy", "policy_of_my_own:make", "--json", folder=tmp_path)
    assert json.loads(done.stdout)["recordings"][0]["policies"][0]["unclamped"]["cloud_pct"] == 100


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "--trace: name a recording, for example --trace examples/traces/corridor-wifi.txt"),
        (["--trace", "nope.txt"], "nope.txt: cannot read the trace: No such file or directory"),
        (["--trace", "LICENSE"], "LICENSE:2: the round-trip time in ms must be a number, found"),
        (["--trace", f"{CORRIDOR}@soon"], f"--trace {CORRIDOR}@soon: 'soon' is not a duration; write"),
        (["--trace", CORRIDOR, "--tolerance", "20"], "--tolerance: '20' is not a duration; write"),
        (["--trace", CORRIDOR, "--robot-period", "1ms", "--tolerance", "0s"], "--tolerance: robot period + tolerance"),
        (["--trace", CORRIDOR, "--loss-timeout", "40ms"], "--loss-timeout: must be more than two heartbeats (40ms)"),
        (["--trace", CORRIDOR, "--weights", "1/0/1"], "--weights: '1/0/1': every price must be more than 0"),
        (["--trace", CORRIDOR, "--weights", "many"], "--weights: 'many': write three numbers, for example 10/1/0.5"),
        (["--trace", CORRIDOR, "--policy", "nobody"], "--policy: there is no policy 'nobody'; write one of ours,"),
        (["--trace", CORRIDOR, "--tune"], "--tune: needs two different traces or more"),
        (["--trace", CORRIDOR, "--trace", f"{CORRIDOR}@50ms", "--tune"], "--tune: needs two different traces or more"),
        (
            ["--trace", CORRIDOR, "--trace", YARD, "--tune", "--report-on", f"{YARD}@50ms"],
            f"--report-on {YARD}: that",
        ),
        (["--trace", CORRIDOR, "--report-on", YARD], "--report-on: only with --tune"),
        (["--trace", CORRIDOR, "--trace", YARD, "--tune", "--compare"], "--tune, --compare: one of them at a time"),
        (["--trace", CORRIDOR, "--out", CORRIDOR], f"--out: cannot write to {CORRIDOR}: File exists"),
    ],
)
def test_wrong_input_ends_with_2_and_one_line(arguments: list[str | Path], line: str) -> None:
    done = run(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    (told,) = done.stderr.splitlines()
    assert told.startswith(line)


def test_the_help_teaches() -> None:
    done = run("--help")
    assert done.returncode == 0
    for words in ("--policy", "module:function", "Examples:", "robot-offload simulate --trace", "J / optimum"):
        assert words in done.stdout
