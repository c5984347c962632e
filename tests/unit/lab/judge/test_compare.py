"""Several modes of the same drive in one picture."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from robot_offload_lab.judge import compare
from robot_offload_lab.judge.recording import Ending, PathPoint, Recording
from tests.unit.lab.judge import recordings


def drive(mode: str, speed_mps: float) -> tuple[dict[str, Any], Recording]:
    run = replace(recordings.RUN, mode=mode)
    path = tuple(PathPoint(run.start_s + t_s, speed_mps * t_s, 0.0, speed_mps) for t_s in range(11))
    endings = ["succeeded", "aborted"] if speed_mps else ["on the way"]
    report = {
        "duration_s": 10.0,
        "goals": [{"ending": ending} for ending in endings],
        "processor": {"robot-agent": 20.0, "robot-navigation": 5.5, "cloud-navigation": 30.0},
    }
    return report, Recording(run=run, outputs={}, path=path, outcome=Ending(run.start_s + 10.0, 0, 0, True))


def test_the_figures_of_each_mode_stand_beside_each_other(tmp_path: Path) -> None:
    found = compare.write({"offload": drive("offload", 0.8), "cloud-only": drive("cloud-only", 0.0)}, tmp_path)
    assert found["offload"] == {
        "seconds": 10.0,
        "metres": 8.0,
        "standing_s": 0.0,
        "succeeded": 1,
        "not_reached": 1,
        "robot_percent": 25.5,
    }
    assert found["cloud-only"]["standing_s"] == 10.0
    assert json.loads((tmp_path / "compare.json").read_text()) == found
    assert (tmp_path / "compare.png").stat().st_size > 10_000
    table = compare.lines(found)
    assert table[0].split() == ["offload", "cloud-only"]
    assert len(table) == 1 + len(compare.FIGURES)
