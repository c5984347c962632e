"""A RobotOffload that is made again goes on with its authorities: the robot's bundle stays good."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.cli.main import app
from robot_offload.decide.authorities import AUTHORITIES
from robot_offload.kube.kinds import CONFIG_MAP, ROBOT_OFFLOAD, SECRET
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import HOME, Place, eventually, walker
from tests.integration.operator_process import Operator

pytestmark = pytest.mark.api


@pytest.fixture
def keeping(control_plane: ControlPlane, namespace: str, tmp_path: Path) -> Iterator[Operator]:
    """An operator that keeps keys, for this test's namespace only."""
    more = {"WATCH_NAMESPACE": namespace, "AUTHORITY_KEEP_DAYS": "30"}
    operator = Operator.start(control_plane.kubeconfig, tmp_path / "log", "keeping", **more)
    operator.wait_said("Became leader")
    yield operator
    operator.stop()


@pytest.fixture
def mine(control_plane: ControlPlane, namespace: str, keeping: Operator) -> Place:
    return Place(control_plane, namespace)


def made(place: Place) -> str:
    """Make the walker; return its uid."""
    place.create(ROBOT_OFFLOAD, walker())
    return str(place.applied()["metadata"]["uid"])


def known_as(place: Place) -> str:
    """The uid by which the cloud's agent knows its robot."""
    text = str(place.there(CONFIG_MAP, "walker-agent")["data"]["agent.yaml"])
    return next(line.partition(":")[2].strip() for line in text.splitlines() if line.strip().startswith("uid:"))


def remove(place: Place) -> None:
    place.delete(ROBOT_OFFLOAD, "walker")
    place.gone(ROBOT_OFFLOAD, "walker")
    eventually(lambda: not place.children(), "no children")


def test_what_is_deleted_and_applied_again_keeps_its_authorities_and_its_robot(mine: Place) -> None:
    first = made(mine)
    before = {role: one["data"] for role, one in mine.authorities().items()}
    assert before.keys() == set(AUTHORITIES)
    for _ in range(2):
        remove(mine)
        uid = made(mine)
        assert uid != first
        assert {role: one["data"] for role, one in mine.authorities().items()} == before
        assert known_as(mine) == first
        assert mine.there(SECRET, "walker-robot")["metadata"]["annotations"]["robotoffload.dev/identity"] == first
    assert not mine.authorities(first), "a key is in one place"


def test_keys_of_what_is_gone_are_kept_and_marked(mine: Place) -> None:
    uid = made(mine)
    remove(mine)
    marked = "robotoffload.dev/orphaned"
    eventually(lambda: all(marked in one["metadata"]["annotations"] for one in mine.authorities(uid).values()), "marks")
    assert mine.authorities(uid).keys() == set(AUTHORITIES)


def test_an_exported_robot_goes_on_where_it_is_applied(
    mine: Place, control_plane: ControlPlane, tmp_path: Path
) -> None:
    uid = made(mine)
    before = {role: one["data"] for role, one in mine.authorities().items()}
    file = tmp_path / "walker.yaml"
    arguments = ("export", "walker", "-n", mine.namespace, "-o", str(file), "--operator-namespace", HOME)
    done = CliRunner().invoke(app, [*arguments, "--kubeconfig", str(control_plane.kubeconfig)])
    assert done.exit_code == 0, done.output
    assert file.stat().st_mode & 0o077 == 0
    remove(mine)
    for secret in mine.authorities(uid).values():  # as in a cluster that has never seen it
        Place(control_plane, HOME).delete(SECRET, secret["metadata"]["name"])
    kubectl = control_plane.kubectl(mine.namespace)  # which would ask for one namespace only
    command = [str(kubectl.program), "--kubeconfig", str(kubectl.kubeconfig), "apply", "-f", str(file)]
    subprocess.run(command, check=True, timeout=120, capture_output=True)
    mine.applied()
    assert {role: one["data"] for role, one in mine.authorities().items()} == before
    assert known_as(mine) == uid
