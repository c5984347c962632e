"""The tutorial's commands, all of them, in their order and in one session, as its reader types them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorial" / "your-robot.md"
LIMIT_S = 400.0
PROLOGUE = """set -m; trap 'kill $(jobs -p) 2> /dev/null || true' EXIT; trap 'echo "FAILED ($?): $BASH_COMMAND"' ERR"""


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.ros
@pytest.mark.timeout(LIMIT_S + 60)
def test_every_command_of_the_tutorial_runs_and_leads_to_the_next_one(tmp_path: Path) -> None:
    for name in ("examples", ".venv"):
        (tmp_path / name).symlink_to(ROOT / name)
    script = f"{PROLOGUE}\n" + "\n".join(blocks("sh"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith("ROS_")}
    with subprocess.Popen(
        ["bash", "-c", script], cwd=tmp_path, env=environment, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as session:  # fmt: skip
        try:
            said, _ = session.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(session.pid, signal.SIGTERM)
            raise
    failed = [line for line in said.splitlines() if line.startswith("FAILED")]
    # 1 of the demo: a promise about time that this machine was too busy for.
    assert [line for line in failed if not line.startswith("FAILED (1): robot-offload demo")] == [], said
    out = tmp_path / "out" / "tutorial"
    assert "robot.yaml: 2 of 2 nodes; leave the robot: talker" in said
    assert "walker is valid" in said
    assert "autostart" not in (out / "robot.yaml").read_text()
    assert (out / "demo" / "report.html").stat().st_size > 0
    assert {path.name for path in (out / "pair").iterdir()} == {"robot", "workstation"}
    assert re.search(r"^(warning|ok) ", said, re.MULTILINE), said


def test_commands_for_a_cluster_are_those_of_the_readme() -> None:
    """The README's are held together by tests/unit/docs/test_cluster_path.py."""
    (block,) = blocks("bash")
    readme = (ROOT / "README.md").read_text()
    for line in block.splitlines():
        words = line.replace("walker", "wheelchair").replace(
            "out/tutorial/robot.yaml", "manifests/samples/wheelchair.yaml"
        )
        assert words in readme, line
