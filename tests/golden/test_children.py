"""All children of every sample: one recorded whole, the others as their differences from that one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload.render.children import children
from tests.golden.differences import differences, dump
from tests.golden.recorded import compare
from tests.unit.operator.render.given import EVERY_ENDPOINT, facts

HERE = Path(__file__).parent / "children"
SAMPLES = {
    file.stem: document
    for file in sorted(Path(__file__).parents[2].glob("manifests/samples/*.yaml"))
    for document in yaml.safe_load_all(file.read_text())
    if document["kind"] == "RobotOffload"
}
CONFIGS = {"nav2-parameters/nav2_params.yaml": "amcl:\n  ros__parameters: {alpha1: 0.2}\n"}
FACTS = facts(endpoints=EVERY_ENDPOINT, robot_connected=True, user_config_hashes=CONFIGS, user_configs=CONFIGS)
SECRETS = BundleSecrets(b"the cloud's authority\n", b"the robot's certificate\n", b"the robot's key\n")
WHOLE = "wheelchair"
BUNDLES = ("dds-router", "discovery-server", "static-peers", "wheelchair")


@pytest.mark.parametrize("name", SAMPLES)
def test_children_of_every_sample_are_as_recorded(name: str) -> None:
    rendered = _children(name)
    if name == WHOLE:
        compare(HERE / f"{name}.yaml", dump(rendered))
    else:
        compare(HERE / f"{name}.diff", differences(rendered, name, _children(WHOLE), WHOLE))


def _children(name: str) -> list[dict[str, Any]]:
    return children(Parent(parse_object(SAMPLES[name], name), FACTS))


@pytest.mark.parametrize("name", BUNDLES)
def test_the_bundle_is_as_recorded(name: str) -> None:
    files = bundle(Parent(parse_object(SAMPLES[name], name), FACTS), SECRETS)
    for path, content in files.items():
        compare(HERE.parent / "bundles" / name / path, content.decode())
    recorded = {str(file.relative_to(HERE.parent / "bundles" / name)) for file in walk(HERE.parent / "bundles" / name)}
    assert recorded == set(files)


def walk(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file()]


def test_every_sample_is_recorded_and_nothing_else() -> None:
    assert SAMPLES
    assert {file.name for file in walk(HERE)} == {f"{name}.{'yaml' if name == WHOLE else 'diff'}" for name in SAMPLES}
