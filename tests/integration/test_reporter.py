"""The reporter against a real API server, with the rights that the operator gives it and no others."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robot_offload.api.agent_state import ANNOTATION
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.cli.cluster import Target
from robot_offload.cli.main import app
from robot_offload.console.cluster import ClusterSource
from robot_offload.console.live import Changeover, Key, Live
from robot_offload.console.model import Event, Said
from robot_offload.kube.port import KubeApi
from robot_offload.objects.facts import Facts, default_images
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.errors import CommandError
from tests.integration.resources import talker
from tests.unit.operator.reporter.running import Beating, Running, eventually
from tests.unit.operator.reporter.states import REPORT, text

pytestmark = pytest.mark.api
RIGHTS = ("ServiceAccount", "Role", "RoleBinding", "Lease")
SETTINGS = "talker-settings"


@pytest.fixture
def lease(kubectl: Kubectl, namespace: str) -> str:
    """The robot's Lease and the reporter's rights as they are rendered; the Lease's name."""
    offload = parse_object(talker(), "talker")
    facts = Facts(namespace=namespace, uid="", generation=1, images=default_images("1"), nodes_wanted=True)
    rendered = [child for child in children(Parent(offload, facts)) if child["kind"] in RIGHTS]
    for child in rendered:
        del child["metadata"]["ownerReferences"]  # there is no RobotOffload here that could own them
    kubectl.apply(*rendered)
    [name] = [child["metadata"]["name"] for child in rendered if child["kind"] == "Lease"]
    return str(name)


@pytest.fixture
def running(control_plane: ControlPlane, namespace: str, lease: str, tmp_path: Path) -> Iterator[Running]:
    assert lease == "talker-robot"
    process = Running(tmp_path, control_plane.kubeconfig_of(namespace, "talker-agent"), namespace, "talker")
    yield process
    assert process.stop() == 0


@pytest.fixture
def says(running: Running) -> Iterator[Callable[..., None]]:
    """Lets the cloud agent say something from now on, again and again; keywords replace fields of its state."""
    beats = Beating(running, lambda number: text(written=str(number)))

    def say(**changes: Any) -> None:
        beats.told = lambda number: text(written=str(number), **changes)
        if not beats.is_alive():
            beats.start()

    yield say
    if beats.is_alive():
        beats.end()


def held(kubectl: Kubectl, holder: str | None) -> dict[str, Any]:
    """The Lease as soon as it has this holder."""

    def look() -> dict[str, Any] | None:
        found: dict[str, Any] = kubectl.json("get", "lease", "talker-robot")
        fits = found["spec"].get("holderIdentity") == holder and ANNOTATION in found["metadata"].get("annotations", {})
        return found if fits else None

    return dict(eventually(look))


def test_the_state_reaches_the_lease_with_the_rendered_role_alone(
    running: Running, says: Callable[..., None], kubectl: Kubectl
) -> None:
    says()
    lease = held(kubectl, "talker")
    assert lease["spec"]["acquireTime"] == "2026-11-21T10:00:00.000000Z"
    assert lease["spec"]["leaseDurationSeconds"] == 30  # of the operator, left alone
    assert json.loads(lease["metadata"]["annotations"][ANNOTATION])["epoch"] == 12
    says(connected=False, site="unknown", epoch=13)
    lease = held(kubectl, None)
    assert json.loads(lease["metadata"]["annotations"][ANNOTATION])["epoch"] == 13
    assert "lease_failures_total 0.0" in running.ask("/metrics")[1]


def settings_of(generation: int) -> str:
    return f"/**:\n  ros__parameters:\n    generation: {generation}\n    pin: Robot\n"


def offer(kubectl: Kubectl, generation: int, **further: str) -> None:
    metadata = {"name": SETTINGS}
    data = {"settings.yaml": settings_of(generation), **further}
    kubectl.apply({"apiVersion": "v1", "kind": "ConfigMap", "metadata": metadata, "data": data})


def test_changed_settings_reach_the_agents_file_by_a_watch_with_the_rendered_role_alone(
    kubectl: Kubectl, namespace: str, control_plane: ControlPlane, lease: str, tmp_path: Path
) -> None:
    mounted, file = tmp_path / "mounted" / "settings.yaml", tmp_path / "run" / "settings.yaml"
    mounted.parent.mkdir()
    file.parent.mkdir()
    mounted.write_text(settings_of(1))  # what the kubelet brought when the pod started, and never brings again here
    answer = tmp_path / "run" / "certificate.json"
    variables = {"SETTINGS_NAME": SETTINGS, "SETTINGS_MOUNTED": str(mounted), "SETTINGS_FILE": str(file)}
    variables["ANSWER_FILE"] = str(answer)
    kubeconfig = control_plane.kubeconfig_of(namespace, "talker-agent")
    process = Running(tmp_path, kubeconfig, namespace, "talker", **variables)
    try:
        eventually(lambda: file.exists() and file.read_text() == settings_of(1))
        for generation in (2, 3):
            offer(kubectl, generation)
            eventually(lambda generation=generation: file.read_text() == settings_of(generation))
        assert not answer.exists()
        offer(kubectl, 3, **{"certificate.json": "an answer"})
        eventually(lambda: answer.exists() and answer.read_text() == "an answer")
        kubectl("delete", "configmap", SETTINGS)
        offer(kubectl, 4)
        eventually(lambda: file.read_text() == settings_of(4))
        assert {path.name for path in file.parent.iterdir()} == {"settings.yaml", "certificate.json"}
    finally:
        assert process.stop() == 0


def test_applying_the_lease_again_takes_nothing_back(
    says: Callable[..., None], kubectl: Kubectl, namespace: str
) -> None:
    says()
    held(kubectl, "talker")
    bare = {
        "apiVersion": "coordination.k8s.io/v1",
        "kind": "Lease",
        "metadata": {"name": "talker-robot", "namespace": namespace},
        "spec": {"leaseDurationSeconds": 30},
    }
    kubectl.apply(bare, options=("--server-side", "--field-manager=robot-offload"))
    assert held(kubectl, "talker")["spec"]["renewTime"]


def test_the_reporter_may_touch_one_lease_and_nothing_else(
    control_plane: ControlPlane, kubectl: Kubectl, namespace: str, lease: str
) -> None:
    own = f"--as=system:serviceaccount:{namespace}:talker-agent"

    def may(*question: str) -> bool:
        try:
            return kubectl("auth", "can-i", *question, own).strip() == "yes"
        except CommandError:  # kubectl ends with 1 for a no
            return False

    assert may("patch", f"lease/{lease}")
    assert not may("patch", "lease/another-robot")
    assert not may("create", "leases")
    assert not may("list", "leases")
    assert may("watch", f"configmap/{SETTINGS}")
    assert not may("watch", "configmap/another-settings")
    assert not may("list", "configmaps")
    assert not may("get", "secrets")
    assert not may("get", "robotoffloads")


def test_a_lease_that_comes_later_is_written_then(
    says: Callable[..., None], kubectl: Kubectl, namespace: str, lease: str, running: Running
) -> None:
    saved = kubectl.json("get", "lease", lease)
    kubectl("delete", "lease", lease)
    says(epoch=20)
    eventually(lambda: "lease_failures_total 0.0" not in running.ask("/metrics")[1])
    kubectl.apply({**saved, "metadata": {"name": lease, "namespace": namespace}})
    assert json.loads(held(kubectl, "talker")["metadata"]["annotations"][ANNOTATION])["epoch"] == 20


def own_address() -> str:
    """An address of this machine that is not the loopback's; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))
        return str(probe.getsockname()[0])


def test_status_and_the_stream_show_live_numbers_through_the_api_server(
    control_plane: ControlPlane, kubectl: Kubectl, namespace: str, running: Running, says: Callable[..., None]
) -> None:
    kubectl.apply(
        {**talker(), "metadata": {"name": "talker", "namespace": namespace}},
        {
            "apiVersion": "v1",
            "kind": "Service",
            "metadata": {"name": "talker-agent", "namespace": namespace},
            "spec": {"ports": [{"name": "http", "port": 8080, "targetPort": running.port}]},
        },
        {
            "apiVersion": "v1",
            "kind": "Pod",
            "metadata": {"name": "agent", "namespace": namespace},
            "spec": {"containers": [{"name": "reporter", "image": "registry.example/operator:1"}]},
        },
    )
    # The API server only asks an address that a pod has; no kubelet is here that could say which.
    address = own_address()
    status = {"status": {"phase": "Running", "podIP": address, "podIPs": [{"ip": address}]}}
    path = f"/api/v1/namespaces/{namespace}/pods/agent/status"
    control_plane.request("PATCH", path, status, "application/merge-patch+json")
    pod = {"kind": "Pod", "name": "agent", "namespace": namespace}
    kubectl.apply(
        {
            "apiVersion": "v1",
            "kind": "Endpoints",
            "metadata": {"name": "talker-agent", "namespace": namespace},
            "subsets": [
                {
                    "addresses": [{"ip": address, "targetRef": pod}],
                    "ports": [{"name": "http", "port": running.port}],
                }
            ],
        }
    )
    options = ("--kubeconfig", str(control_plane.kubeconfig), "-n", namespace)

    def shown(*arguments: str) -> str:
        done = CliRunner().invoke(app, [*arguments, *options])
        assert done.exit_code == 0, done.output
        return done.stdout

    def silent() -> bool:
        found = json.loads(shown("status", "talker", "--json"))[0]
        assert not found["live"]
        return bool(found["liveProblem"] == "there is no state file: the agent has not started")

    eventually(silent)  # the API server learns of the endpoints a moment later
    says()
    eventually(lambda: running.ask("/readyz")[0] == 200)
    found = json.loads(shown("status", "--json"))[0]
    assert (found["live"], found["placement"], found["roundTripMs"]) == (True, "Cloud", {"p50": 11.5, "p99": 19.0})
    assert "12 ms (p99 19 ms)" in shown("status")
    assert "12 ms (p99 19 ms)" in shown("status", "talker")
    stream = f"/api/v1/namespaces/{namespace}/services/http:talker-agent:8080/proxy/stream"
    command = [str(kubectl.program), "--kubeconfig", str(kubectl.kubeconfig), "get", "--raw", stream]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as following:
        try:
            assert following.stdout is not None
            data = (json.loads(line[6:]) for line in following.stdout if line.startswith("data: "))
            epochs = (event["state"]["epoch"] for event in data if event["state"] is not None)
            assert next(epochs) == 12
            says(epoch=13)
            assert 13 in epochs
        finally:
            following.terminate()
    target = Target(str(control_plane.kubeconfig), None, namespace)
    live = target.run(lambda api: followed(api, namespace, says))
    assert (live.epoch, live.note) == (14, "")  # of the stream: who is only asked says so
    assert (live.last, live.topics[0].age_ms) == (Changeover(-40.0, "cloud", "LinkGood", gap_ms=61.5), 9)


async def followed(api: KubeApi, namespace: str, says: Callable[..., None]) -> Live:
    """What the console's source makes of the stream after a change of the state."""
    key, said, source = Key(namespace, "talker"), [Live()], ClusterSource(api, namespace, "test")

    def publish(event: Event) -> None:
        if isinstance(event, Said):
            said.append(event.live)

    with source.watching(key):
        following = asyncio.create_task(source.run(publish))
        async with asyncio.timeout(60):
            while said[-1].epoch != 13:
                await asyncio.sleep(0.02)
            says(epoch=14, robot=REPORT)
            while said[-1].epoch != 14:
                await asyncio.sleep(0.02)
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)
    return said[-1]
