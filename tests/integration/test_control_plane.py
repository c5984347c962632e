"""The test cluster itself: what the other integration tests rely on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robot_offload_lab.cluster import directories, processes
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.errors import CommandError
from robot_offload_lab.cluster.pretended_kubelet import report_ready
from tests.integration.resources import talker

pytestmark = pytest.mark.api

ROOT = Path(__file__).parents[2]


def config_map(name: str, **data: str) -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": name}, "data": data}


def deployment(name: str) -> dict[str, Any]:
    labels = {"app": name}
    template = {"metadata": {"labels": labels}, "spec": {"containers": [{"name": "c", "image": "x"}]}}
    spec = {"replicas": 1, "selector": {"matchLabels": labels}, "template": template}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": {"name": name}, "spec": spec}


def test_server_and_client_report_the_pinned_version(kubectl: Kubectl) -> None:
    versions = kubectl.json("version")
    assert versions["serverVersion"]["gitVersion"] == versions["clientVersion"]["gitVersion"] == "v1.34.4"


def test_an_object_that_is_applied_can_be_read_back(kubectl: Kubectl) -> None:
    kubectl.apply(config_map("settings", speed="1"))
    assert kubectl.json("get", "configmap", "settings")["data"] == {"speed": "1"}


def test_a_second_field_manager_is_told_of_the_conflict(kubectl: Kubectl) -> None:
    kubectl.apply(config_map("settings", speed="1"), options=("--server-side", "--field-manager=first"))
    second = ("--server-side", "--field-manager=second")
    assert 'conflict with "first"' in kubectl.apply_refused(config_map("settings", speed="2"), options=second)


def test_a_deployment_gets_its_pod_and_takes_it_along(kubectl: Kubectl) -> None:
    kubectl.apply(deployment("worker"))
    kubectl("wait", "--for=create", "pods", "-l", "app=worker", "--timeout=110s")
    kubectl("delete", "deployment", "worker")
    kubectl("wait", "--for=delete", "replicasets,pods", "-l", "app=worker", "--timeout=110s")
    assert kubectl.names("replicasets,pods") == []


def test_a_deployment_is_available_once_its_pods_are_reported_ready(
    control_plane: ControlPlane, kubectl: Kubectl
) -> None:
    kubectl.apply(deployment("worker"))
    kubectl("wait", "--for=create", "pods", "-l", "app=worker", "--timeout=110s")
    assert len(report_ready(control_plane, kubectl.namespace)) == 1
    kubectl("wait", "--for=condition=Available", "deployment/worker", "--timeout=110s")


def test_children_of_our_resource_go_with_it(kubectl: Kubectl) -> None:
    # Where the controllers start before the definitions, the first child waits 40 s: longer than this wait.
    owner = talker()
    kubectl.apply(owner)
    identity = {**owner, "uid": kubectl.json("get", "roff", "talker")["metadata"]["uid"]}
    reference = {key: identity[key] for key in ("apiVersion", "kind", "uid")} | {"name": "talker"}
    child = config_map("child")
    child["metadata"]["ownerReferences"] = [reference]
    kubectl.apply(child)
    kubectl("delete", "roff", "talker")
    kubectl("wait", "--for=delete", "configmap/child", "--timeout=30s")


def test_a_restricted_namespace_refuses_a_pod_that_asks_for_too_much(
    control_plane: ControlPlane, restricted_namespace: str
) -> None:
    kubectl = control_plane.kubectl(restricted_namespace)
    refusal = kubectl.refuses("run", "greedy", "--image=x", "--privileged")
    assert 'violates PodSecurity "restricted' in refusal


def test_a_service_account_has_its_own_rights_and_no_others(control_plane: ControlPlane, kubectl: Kubectl) -> None:
    kubectl("create", "serviceaccount", "reader")
    kubectl("create", "role", "reader", "--verb=get", "--resource=configmaps")
    kubectl("create", "rolebinding", "reader", "--role=reader", f"--serviceaccount={kubectl.namespace}:reader")
    kubectl.apply(config_map("settings", speed="1"))
    reader = Kubectl(kubectl.program, control_plane.kubeconfig_of(kubectl.namespace, "reader"), kubectl.namespace)
    assert reader.json("get", "configmap", "settings")["data"] == {"speed": "1"}
    with pytest.raises(CommandError, match="cannot delete resource"):
        reader("delete", "configmap", "settings")


def test_the_audit_log_tells_who_asked_for_what(control_plane: ControlPlane, kubectl: Kubectl) -> None:
    kubectl.apply(config_map("audited"))
    asked = [
        (event["verb"], event["user"]["username"])
        for event in control_plane.audit()
        if event.get("objectRef", {}).get("name") == "audited" and event["objectRef"]["namespace"] == kubectl.namespace
    ]
    assert ("patch", "admin") in asked


def test_a_killed_test_run_leaves_no_process_and_the_next_run_its_files(
    cluster_programs: object, tmp_path: Path
) -> None:
    script = (
        "from robot_offload_lab.cluster import directories, programs\n"
        "from robot_offload_lab.cluster.control_plane import ControlPlane\n"
        "with directories.of_this_run() as home:\n"
        "    print(home, flush=True)\n"
        "    ControlPlane(home, programs.ensure(print)).start()\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-c", script], cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        home = Path(run.stdout.readline().strip())
        while len(processes.running(home)) < 2:  # etcd and the API server
            time.sleep(0.01)
        run.send_signal(signal.SIGKILL)
    while processes.running(home):  # the kernel kills them; nobody else does
        time.sleep(0.01)
    assert directories.sweep(tmp_path) == [home.parent]
    assert list(tmp_path.iterdir()) == []


class ByHand:
    """`python -m robot_offload_lab.cluster`, with its files under a directory of the test."""

    def __init__(self, base: Path) -> None:
        self.home = base / "robot-offload" / "clusters" / "by-hand"
        self._environment = {**os.environ, "XDG_STATE_HOME": str(base), "TMPDIR": str(base)}

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "robot_offload_lab.cluster", "--name", "by-hand", *arguments]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, cwd=ROOT, env=self._environment, stdout=pipe, stderr=pipe, text=True)

    def __call__(self, *arguments: str) -> tuple[str, str]:
        """Run it to its end; what it printed to stdout and stderr."""
        with self.start(*arguments) as command:
            return command.communicate()


@pytest.fixture
def by_hand(cluster_programs: object, tmp_path: Path) -> Iterator[ByHand]:
    cluster = ByHand(tmp_path)
    yield cluster
    processes.kill(cluster.home)


def test_a_cluster_by_hand_outlives_the_command_and_goes_when_told(by_hand: ByHand) -> None:
    assert f"export KUBECONFIG={by_hand.home}/kubeconfig" in by_hand("up")[0]
    assert "kube-controller-manager" in by_hand("status")[0]
    assert "robotoffloads.robotoffload.dev" in by_hand("kubectl", "get", "crd", "-o", "name")[0]
    assert "3 processes ended" in by_hand("down")[1]
    assert processes.running(by_hand.home) == {}
    assert not by_hand.home.exists()
    assert "Next: python -m robot_offload_lab.cluster up" in by_hand("status")[1]


def test_down_removes_what_a_killed_up_has_left(by_hand: ByHand) -> None:
    with by_hand.start("up") as up:
        while not processes.running(by_hand.home):
            time.sleep(0.01)
        up.send_signal(signal.SIGKILL)
    assert processes.running(by_hand.home) != {}
    assert "files removed" in by_hand("down")[1]
    assert processes.running(by_hand.home) == {}
    assert not by_hand.home.exists()


def test_ctrl_c_during_up_leaves_nothing(by_hand: ByHand) -> None:
    with by_hand.start("up") as up:
        while not processes.running(by_hand.home):
            time.sleep(0.01)
        up.send_signal(signal.SIGINT)
        assert "nothing is left" in up.communicate()[1]
    assert processes.running(by_hand.home) == {}
    assert not by_hand.home.exists()
