"""A team's own messages and distribution: the agent's image in the cloud, the setup script on the robot."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from robot_offload.errors import SpecError
from robot_offload.objects.parent import Parent
from robot_offload.render.agent_workload import agent_deployment
from robot_offload.render.bundle import BundleSecrets, bundle
from tests.unit.operator.render.given import EVERY_ENDPOINT, FACTS, facts, offload

SECRETS = BundleSecrets(b"ca", b"certificate", b"a private key")
IMAGE = "registry.example/team/agent:kilted-7"
SETUP = "/opt/team/install/setup.bash"
OWN: dict[str, Any] = {
    "cloud": {"agent": {"image": IMAGE}},
    "robot": {"rosDistro": "kilted", "interfaces": {"setup": SETUP}},
}


def test_the_agent_runs_the_declared_image_and_the_reporter_beside_it_the_operators() -> None:
    containers = agent_deployment(Parent(offload(**OWN), FACTS))["spec"]["template"]["spec"]["containers"]
    assert {each["name"]: each["image"] for each in containers} == {
        "agent": IMAGE,
        "reporter": FACTS.images.operator,
    }
    mounted = {each["name"] for each in containers for mount in each["volumeMounts"] if mount["name"] == "token"}
    assert mounted == {"reporter"}  # whoever brings an image gets no token with it


def test_the_bundle_starts_the_agent_with_the_robots_own_messages_and_the_same_image() -> None:
    files = bundle(Parent(offload(**OWN), facts(endpoints=EVERY_ENDPOINT)), SECRETS)
    assert f"ROBOT_OFFLOAD_SETUP={SETUP}\n" in files["environment"].decode()
    assert yaml.safe_load(files["compose.yaml"])["services"]["agent"]["image"] == IMAGE
    readme = files["README.md"].decode()
    assert f"The agent takes your message types from `{SETUP}`" in readme
    assert "write the setup script of your workspace" not in readme


@pytest.mark.parametrize(
    "path", ["setup.bash", "/opt/../etc/setup.bash", "/opt/a b/setup.bash", "/opt/x;id/setup.sh", "/"]
)
def test_a_setup_script_is_a_whole_path_that_no_shell_reads_otherwise(path: str) -> None:
    with pytest.raises(SpecError, match="is not a setup script"):
        offload(robot={"interfaces": {"setup": path}})
