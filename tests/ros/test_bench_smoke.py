import csv
import json
import os
import secrets
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

MARK = "ROBOT_OFFLOAD_BENCH_TEST"
SWITCHES = 6
SECONDS = 90


@pytest.mark.ros
def test_a_short_bench_of_commanded_switches_writes_results_samples_and_the_page_and_leaves_no_process(tmp_path: Path):
    run = secrets.token_hex(8)
    command = [
        sys.executable, "-m", "robot_offload_lab.bench", "switch", "--only", "commanded", "--switches", str(SWITCHES),
        "--normal", "--out", str(tmp_path / "out"), "--docs", str(tmp_path / "docs"), "--domains", "83/84", "--json",
    ]  # fmt: skip
    environment = {**os.environ, MARK: run}
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False)
        assert ended.returncode == 0, ended.stderr
    finally:
        left = marked(run)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
    assert not left

    document = json.loads(ended.stdout)
    assert document == json.loads((tmp_path / "out" / "results.json").read_text())
    figures = {figure["name"]: figure for figure in document["groups"]["commanded"]["normal"]["figures"]}
    assert figures["faults"]["count"] == SWITCHES
    assert figures["faults"]["value"] == 0
    assert figures["gap_p99"]["count"] == SWITCHES
    assert 0 < figures["gap_p99"]["value"] < 5000
    assert figures["gap_p99"]["must"] == 60.0
    with (tmp_path / "out" / "commanded-normal.csv").open(newline="") as file:
        assert {row["to"] for row in csv.DictReader(file)} == {"robot", "cloud"}
    assert "Command gap at a commanded switch, p99" in (tmp_path / "docs" / "benchmarks.md").read_text()


def test_wrong_input_is_told_in_one_line(tmp_path: Path):
    command = [sys.executable, "-m", "robot_offload_lab.bench", "switch", "--out", str(tmp_path), "--domains", "1/1"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert ended.returncode == 2
    assert ended.stderr == "--domains: '1/1': write two different numbers from 0 to 232, for example 81/82\n"


def marked(run: str) -> list[int]:
    """The processes that carry the mark of a run, whoever started them."""
    found = []
    for folder in Path("/proc").iterdir():
        with suppress(OSError):  # it may end while we look
            if folder.name.isdigit() and f"{MARK}={run}".encode() in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
    return found
