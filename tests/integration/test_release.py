"""What `make release` publishes: made once, and each piece used as its reader uses it."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from robot_offload_lab.cluster.commands import Helm
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.chart import RELEASE, ROOT, of_kind

pytestmark = pytest.mark.api
REGISTRY = "mirror.example:5000/robots"
DIGEST = f"sha256:{'5e' * 32}"
URL = "https://releases.example/v{version}"
SAMPLE = ROOT / "manifests" / "samples" / "talker.yaml"
TEXT = {"type": "string", "minLength": 1}
LABELS = {
    "type": "object", "minProperties": 1, "additionalProperties": False, "properties": {"os": TEXT, "arch": TEXT}
}  # fmt: skip
PLATFORM = {
    "type": "object",
    "required": ["uri", "sha256", "bin", "selector"],
    "additionalProperties": False,
    "properties": {
        "uri": TEXT,
        "sha256": {"type": "string", "pattern": "^[a-f0-9]{64}$"},
        "bin": TEXT,
        "selector": {"type": "object", "required": ["matchLabels"], "properties": {"matchLabels": LABELS}},
    },
}
KREW = {
    "type": "object",
    "required": ["apiVersion", "kind", "metadata", "spec"],
    "properties": {
        "apiVersion": {"const": "krew.googlecontainertools.github.com/v1alpha2"},
        "kind": {"const": "Plugin"},
        "metadata": {"type": "object", "properties": {"name": {"type": "string", "pattern": r"^[\w-]+$"}}},
        "spec": {
            "type": "object",
            "required": ["version", "shortDescription", "platforms"],
            "additionalProperties": False,
            "properties": {
                "version": {"type": "string", "pattern": r"^v\d+\.\d+\.\d+(-[\w.]+)?$"},
                "shortDescription": {"type": "string", "pattern": r"^[^\r\n]+$"},
                "homepage": TEXT,
                "description": TEXT,
                "caveats": TEXT,
                "platforms": {"type": "array", "minItems": 1, "items": PLATFORM},
            },
        },
    },
}
"""krew's rules for a manifest (index/validation of v0.4), as a schema: krew itself cannot be installed everywhere."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, cluster_programs: object) -> Path:
    """A release whose images were pushed to a mirror, but for the router's."""
    folder = tmp_path_factory.mktemp("release")
    names = ("agent", "discovery", "examples/talker", "git", "operator")
    (folder / "digests.txt").write_text("".join(f"{name} {DIGEST}\n" for name in names))
    command = [sys.executable, "-m", "scripts.release", "--output", str(folder), "--registry", REGISTRY, "--url", URL]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def version() -> str:
    chart: Mapping[str, Any] = yaml.safe_load((ROOT / "charts/robot-offload/Chart.yaml").read_text())
    return str(chart["appVersion"])


def test_every_file_is_there_and_its_checksum_is_right(folder: Path) -> None:
    wheels = {f"{name}-{version()}-py3-none-any.whl" for name in (
        "robot_offload", "robot_offload_agent", "robot_offload_core", "robot_offload_lab", "robot_offload_state",
    )}  # fmt: skip
    archives = {path.name for path in folder.glob("kubectl-offload-*.tar.gz")}
    assert len(archives) == 1
    assert {path.name for path in folder.iterdir()} == wheels | archives | {
        f"robot-offload-{version()}.tgz", "argocd-health.lua", "checksums.txt", "constraints.txt", "digests.txt",
        "images.txt", "install.yaml", "krew-offload.yaml", "sbom.cdx.json", "values-images.json",
    }  # fmt: skip
    done = subprocess.run(
        ["sha256sum", "--check", "--strict", "checksums.txt"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert len(done.stdout.splitlines()) == len(list(folder.iterdir())) - 2  # without itself and digests.txt


def test_images_are_named_by_their_digests_and_without_one_by_their_tag(folder: Path) -> None:
    listed = (folder / "images.txt").read_text().split()
    assert f"{REGISTRY}/agent@{DIGEST}" in listed
    assert f"{REGISTRY}/router:{version()}" in listed
    assert len(listed) == len(set(listed)) == 10  # five of ours, four of the examples, buildah
    assert {word for word in listed if "@" not in word and ":" not in word} == set()


def test_the_chart_archive_installs_with_the_images_of_the_release(folder: Path, helm: Helm) -> None:
    archive = folder / f"robot-offload-{version()}.tgz"
    options = ("--values", str(folder / "values-images.json"), "--set", "crds.install=false", "--dry-run=server")
    said = helm("install", RELEASE, str(archive), *options, "--output", "json")
    objects = [each for each in yaml.safe_load_all(json.loads(said)["manifest"]) if each]
    (deployment,) = of_kind(objects, "Deployment")
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    assert container["image"] == f"{REGISTRY}/operator@{DIGEST}"
    told = {each["name"]: each.get("value") for each in container["env"]}
    assert told["ROUTER_IMAGE"] == f"{REGISTRY}/router:{version()}"


def test_the_install_manifest_is_taken_by_the_api_server(folder: Path, bare_control_plane: ControlPlane) -> None:
    kubectl = bare_control_plane.kubectl("robot-offload-system")
    text = (folder / "install.yaml").read_text()
    namespace, *_ = yaml.safe_load_all(text)
    kubectl.within("").apply(namespace)
    kubectl.within("")("apply", "--server-side", "--dry-run=server", "-f", "-", stdin=text)
    assert f"{REGISTRY}/agent@{DIGEST}" in text
    kubectl.within("")("delete", "namespace", "robot-offload-system", "--wait=true", "--timeout=110s")


def test_the_bill_of_materials_is_valid_and_names_every_pinned_library_with_what_it_needs(folder: Path) -> None:
    text = (folder / "sbom.cdx.json").read_text()
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    bill = json.loads(text)
    found = {one["name"]: one for one in bill["components"]}
    pins = re.findall(r"^([a-z0-9-]+)(?:\[\S+\])?==([^\s;\\]+)", (ROOT / "requirements/all.txt").read_text(), re.M)
    assert len(pins) > 100
    assert {name: found[name]["version"] for name, _ in pins} == dict(pins)
    assert all(found[name]["hashes"] for name, _ in pins)
    needs = {one["ref"]: one.get("dependsOn", []) for one in bill["dependencies"]}
    own = found["robot-offload"]["bom-ref"]
    assert found["pydantic"]["bom-ref"] in needs[own]
    assert found["pydantic-core"]["bom-ref"] in needs[found["pydantic"]["bom-ref"]]
    assert found[f"{REGISTRY}/agent"]["version"] == DIGEST


def test_the_plugin_installs_from_its_archive_and_runs_as_kubectl_offload(
    folder: Path, bare_control_plane: ControlPlane, tmp_path: Path
) -> None:
    manifest = yaml.safe_load((folder / "krew-offload.yaml").read_text())
    jsonschema.validate(manifest, KREW)
    (platform,) = manifest["spec"]["platforms"]
    archive = folder / Path(platform["uri"]).name
    assert platform["uri"] == f"{URL.format(version=version())}/{archive.name}"
    assert platform["sha256"] == hashlib.sha256(archive.read_bytes()).hexdigest()
    # As krew does: the archive into a folder, and a link to its program.
    with tarfile.open(archive) as packed:
        packed.extractall(tmp_path / "store", filter="data")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "kubectl-offload").symlink_to(tmp_path / "store" / platform["bin"])
    python = Path(sys.executable).resolve().parent  # without the libraries of this environment
    environment = {"PATH": f"{tmp_path}/bin:{python}:/usr/bin:/bin", "HOME": str(tmp_path)}
    environment["KUBECONFIG"] = str(bare_control_plane.kubeconfig)
    kubectl = str(bare_control_plane.kubectl().program)
    assert not any("site-packages" in word for word in os.environ.get("PYTHONPATH", "").split(":"))

    def plugin(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [kubectl, "offload", *arguments]
        return subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)

    assert plugin("--version").stdout.strip() == f"robot-offload {version()}"
    assert "talker is valid" in plugin("validate", str(SAMPLE)).stdout
    said = plugin("status")  # asks the API server, which may not have the kind: the libraries for clusters are there
    assert said.returncode == 0 or "the cluster does not know RobotOffload" in said.stderr, said.stderr


def test_digests_that_cannot_be_read_end_with_2_and_name_the_line(tmp_path: Path) -> None:
    (tmp_path / "digests.txt").write_text("agent latest\n")
    command = [sys.executable, "-m", "scripts.release", "--output", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "'agent latest'" in done.stderr
