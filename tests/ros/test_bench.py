"""One small real measurement: nodes, manager, figures, page. `make bench` measures everything."""

from __future__ import annotations

import csv
import os
import secrets
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robot_offload_lab.run import marked

MARK = "ROBOT_OFFLOAD_BENCH_TEST"
ROUNDS = 2
SECONDS = 240


@pytest.mark.ros
def test_a_short_bench_writes_figures_samples_and_the_page_and_leaves_no_process(tmp_path: Path):
    run = secrets.token_hex(8)
    command = [
        sys.executable, "-m", "robot_offload", "bench", "lifecycle", "--set", f"rounds={ROUNDS}", "--case", "alone",
        "--case", "heavy", "--out", str(tmp_path / "out"), "--docs", str(tmp_path / "docs"), "--domains", "83/84",
    ]  # fmt: skip
    environment = {**os.environ, MARK: run}
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False)
        assert ended.returncode == 0, ended.stderr
    finally:
        pids = marked.find(run, MARK)
        left = marked.named(pids)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
    assert left == []

    with (tmp_path / "out" / "benchmarks.csv").open(newline="") as file:
        figures = {row["name"]: row for row in csv.DictReader(file)}
    assert figures["refused"]["value"] == "0"
    assert figures["alone_activate_p50"]["count"] == str(ROUNDS)
    assert float(figures["alone_activate_p50"]["value"]) > 0
    assert float(figures["heavy_activate_p50"]["value"]) >= 50.0  # the work in its callback
    assert "among_activate_p50" not in figures
    with (tmp_path / "out" / "lifecycle-realtime.csv").open(newline="") as file:
        assert {row["case"] for row in csv.DictReader(file)} == {"alone", "heavy"}
    assert (tmp_path / "docs" / "benchmarks.csv").read_bytes() == (tmp_path / "out" / "benchmarks.csv").read_bytes()
    assert "a heavy node" in (tmp_path / "docs" / "benchmarks.md").read_text()
