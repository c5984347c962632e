"""The README's way to a cluster: what one command makes is what the next one names. Types them without a cluster."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import yaml

from tests.readme import cluster_commands

ROOT = Path(__file__).parents[3]
NAMESPACE = "robot-offload-system"
REGISTRY = "registry.example/robots"
SAMPLE = Path("manifests/samples/wheelchair.yaml")
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def pushed(line: str) -> set[str]:
    """What the first command would push: its own command line, with the builder's work left out."""
    assert line == f"make images REGISTRY={REGISTRY} ARGS=--push"
    words = line.replace("ARGS=--push", 'ARGS="--push --dry-run --builder buildah"').replace("make", "make -o venv")
    done = subprocess.run(["bash", "-c", words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {f"{name}:{tag}" for name, tag in re.findall(rf"push .*?({REGISTRY}/\S+?):(\S+)", done.stdout)}


def test_images_that_are_pushed_are_those_that_chart_and_sample_name(tmp_path: Path) -> None:
    images, install, edit, apply, *_ = cluster_commands()
    made = pushed(images)
    chart = yaml.safe_load((ROOT / "charts/robot-offload/Chart.yaml").read_text())
    assert {f"{REGISTRY}/{name}:{chart['appVersion']}" for name in ("agent", "operator", "discovery", "git")} <= made
    assert f"--set images.registry={REGISTRY}" in install
    assert (ROOT / install.split()[3]).is_dir()
    (tmp_path / SAMPLE.parent).mkdir(parents=True)
    shutil.copy(ROOT / SAMPLE, tmp_path / SAMPLE)
    subprocess.run(["bash", "-c", edit], cwd=tmp_path, check=True)
    assert apply == f"kubectl apply -f {SAMPLE}"
    nodes = yaml.safe_load((tmp_path / SAMPLE).read_text())["spec"]["nodes"]
    of_nodes = {node["image"] for node in nodes if "image" in node}
    assert of_nodes
    assert of_nodes <= made


def test_commands_about_one_robot_name_that_of_the_sample() -> None:
    name = yaml.safe_load((ROOT / SAMPLE).read_text())["metadata"]["name"]
    about = [line for line in cluster_commands() if line.startswith("kubectl offload")]
    assert [line.split()[2:4] for line in about] == [["explain", name], ["bundle", name]]


def test_all_pages_install_into_one_namespace() -> None:
    found = {
        namespace
        for page in PAGES
        for line in page.read_text().replace("\\\n", " ").splitlines()
        if re.match(r"\s*helm (install|upgrade|rollback|uninstall)\b", line)
        for namespace in re.findall(r"(?:--namespace|-n)[ =](\S+)", line)
    }
    assert found == {NAMESPACE}
