"""The README's path to a cluster, command by command, as its reader types it: real helm, kubectl and API server.

No pods run here: what these images do, and a robot that drives with its bundle, is in tests/e2e/test_first_drive.py.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.chart import ROOT
from tests.readme import cluster_commands

pytestmark = pytest.mark.api
NAMESPACE = "robot-offload-system"
REGISTRY = "registry.example/robots"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


class Reader:
    """Types commands in a checkout, and has helm, kubectl and our plugin on the search path."""

    def __init__(self, plane: ControlPlane, folder: Path) -> None:
        self.folder = folder
        programs = Path(plane.kubectl().program).parent
        path = f"{programs}:{Path(sys.executable).parent}:{os.environ['PATH']}"
        self.environment = {"PATH": path, "HOME": str(folder), "KUBECONFIG": str(plane.kubeconfig)}

    def types(self, line: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", line], cwd=self.folder, env=self.environment, capture_output=True, text=True, check=False
        )

    def sees(self, line: str) -> str:
        done = self.types(line)
        assert done.returncode == 0, f"{line}: {done.stderr}"
        return done.stdout


@pytest.fixture
def reader(bare_control_plane: ControlPlane, tmp_path: Path) -> Iterator[Reader]:
    for part in ("charts", "manifests"):
        shutil.copytree(ROOT / part, tmp_path / part)
    found = Reader(bare_control_plane, tmp_path)
    yield found
    found.types(f"helm uninstall robot-offload --namespace {NAMESPACE}")
    found.types(f"kubectl delete crd,namespace robotoffloads.robotoffload.dev {NAMESPACE} --wait=true --timeout=110s")
    found.types("kubectl delete crd robotoffloads.robotoffload.dev --wait=true --timeout=110s")
    found.types(f"kubectl delete namespace {NAMESPACE} --wait=true --timeout=110s")


def test_every_command_of_the_readme_does_what_the_next_one_needs(reader: Reader) -> None:
    images, install, edit, apply, get, explain, bundle = cluster_commands()
    made = built(images)
    assert {f"{REGISTRY}/{name}" for name in ("agent", "operator", "discovery", "examples/wheelchair")} <= made.keys()
    assert "deployed" in reader.sees(install)
    deployment = yaml.safe_load(reader.sees(f"kubectl get deployment -n {NAMESPACE} -o yaml"))["items"][0]
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    named = {one["name"]: one.get("value", "") for one in container["env"] if one["name"].endswith("_IMAGE")}
    ours = {container["image"], *(image for image in named.values() if image.startswith(REGISTRY))}
    assert {f"{name}:{tag}" for name, tag in made.items()} >= ours
    assert len(ours) >= 3
    reader.sees(edit)
    reader.sees(apply)
    assert "wheelchair" in reader.sees(get)
    nodes = yaml.safe_load(reader.sees("kubectl get roff wheelchair -o yaml"))["spec"]["nodes"]
    of_nodes = {node["image"] for node in nodes if "image" in node}
    assert of_nodes
    assert of_nodes <= {f"{name}:{tag}" for name, tag in made.items()}
    said = reader.types(explain)  # ends with 1 while the robot is not Ready
    assert said.returncode == 1
    assert "robot-offload-operator" in said.stdout, "the next step: no pods run here, so no operator has looked"
    waiting = reader.types(f"{bundle} --timeout 0s")  # no pods run here, so nobody makes its certificates
    assert waiting.returncode == 1
    assert "wheelchair" in waiting.stderr


def built(line: str) -> dict[str, str]:
    """What the README's first command would push, by name: its own command line, with the builder's work left out."""
    assert line == f"make images REGISTRY={REGISTRY} ARGS=--push"
    words = line.replace("ARGS=--push", 'ARGS="--push --dry-run --builder buildah"').replace("make", "make -o venv")
    done = subprocess.run(["bash", "-c", words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pushed = re.findall(rf"push .*?({REGISTRY}/\S+?):(\S+)", done.stdout)
    return dict(pushed)


def test_all_pages_install_into_one_namespace() -> None:
    found = {
        (page.relative_to(ROOT), namespace)
        for page in PAGES
        for line in page.read_text().replace("\\\n", " ").splitlines()
        if re.match(r"\s*helm (install|upgrade|rollback|uninstall)\b", line)
        for namespace in re.findall(r"(?:--namespace|-n)[ =](\S+)", line)
    }
    assert found
    assert {namespace for _, namespace in found} == {NAMESPACE}
