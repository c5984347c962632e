"""The command line against a real API server with a real operator: status, explain, bundle, pin, revoke, doctor."""

from __future__ import annotations

import base64
import itertools
import json
import secrets
import signal
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from cryptography import x509
from typer.testing import CliRunner, Result

from robot_offload.cli.main import app
from robot_offload.kube.kinds import ROBOT_OFFLOAD, SECRET
from robot_offload.render.bundle import PRIVATE_KEY
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.pretended_kubelet import report_ready
from tests.integration.operator_cluster import Place, eventually, walker
from tests.integration.operator_process import Operator

pytestmark = pytest.mark.api
Run = Callable[..., Result]
HOST = {"type": "Zenoh", "expose": {"type": "NodePort", "host": "robots.example.com"}}
"""Addresses that are known without a load balancer and without nodes."""


@pytest.fixture(scope="module")
def operator(control_plane: ControlPlane, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Operator]:
    operator = Operator.start(control_plane.kubeconfig, tmp_path_factory.mktemp("operator") / "log")
    operator.wait_said("Became leader")
    yield operator
    assert operator.stop() == 0


@pytest.fixture
def place(control_plane: ControlPlane, namespace: str, operator: Operator) -> Place:
    assert operator.exit_code is None
    return Place(control_plane, namespace)


@pytest.fixture
def run(place: Place) -> Run:
    """The command line in this test's namespace."""
    return in_place(place)


@pytest.fixture(scope="module")
def shared(control_plane: ControlPlane, operator: Operator) -> Iterator[Place]:
    """A namespace with one RobotOffload that no test changes; its addresses and certificates are there."""
    assert operator.exit_code is None
    namespace = f"cli-{secrets.token_hex(3)}"
    control_plane.new_namespace(namespace)
    found = Place(control_plane, namespace)
    addressed(found)
    yield found
    control_plane.kubectl()("delete", "namespace", namespace, "--wait=false")


@pytest.fixture
def ask(shared: Place) -> Run:
    """The command line in the shared namespace."""
    return in_place(shared)


def in_place(place: Place) -> Run:
    def command(*arguments: str) -> Result:
        options = ["--kubeconfig", str(place.plane.kubeconfig), "--namespace", place.namespace]
        return CliRunner().invoke(app, [*arguments, *options])

    return command


def addressed(place: Place, **spec: Any) -> dict[str, Any]:
    """A RobotOffload with addresses, as soon as it has them and its certificates."""
    place.create(ROBOT_OFFLOAD, walker(**{"transport": HOST, **spec}))
    place.wait_condition("CertificatesReady", "True")
    return eventually(
        lambda: place.roff() if len(place.roff().get("status", {}).get("endpoints", ())) == 4 else {},
        "four endpoints",
        lambda: place.roff().get("status"),
    )


def serial(pem: bytes) -> int:
    return x509.load_pem_x509_certificate(pem).serial_number


# -- status and explain -----------------------------------------------------------------------------------------------


def test_status_tells_what_the_operator_has_found(shared: Place, ask: Run) -> None:
    [found] = json.loads(ask("status", "--json").stdout)
    assert (found["name"], found["placement"], found["reason"]) == ("walker", "Unknown", "NotConnected")
    assert {endpoint["host"] for endpoint in found["endpoints"]} == {"robots.example.com"}
    table = ask("status").stdout.splitlines()
    assert table[0].split() == ["NAME", "PLACEMENT", "REASON", "ROBOT", "LATENCY", "NODES", "READY", "AGE"]
    assert table[1].split()[:3] == ["walker", "Unknown", "NotConnected"]
    assert f"robots.example.com:{found['endpoints'][0]['port']}" in ask("status", "walker").stdout


def test_watching_prints_what_is_new_until_it_is_interrupted(place: Place, tmp_path: Path) -> None:
    addressed(place)
    log = tmp_path / "log"
    command = [sys.executable, "-m", "robot_offload", "status", "walker", "--watch", "--json"]
    options = ["--kubeconfig", str(place.plane.kubeconfig), "-n", place.namespace]
    with log.open("w") as output:
        process = subprocess.Popen([*command, *options], stdout=output, stderr=subprocess.STDOUT)
    try:
        eventually(log.read_text, "a first picture")
        place.change({"switching": {"pin": "Robot"}})
        eventually(lambda: '"pin": "Robot"' in log.read_text(), "the change", log.read_text)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.wait()
    pictures = [json.loads(line)[0] for line in log.read_text().splitlines()]
    assert (pictures[0]["pin"], pictures[-1]["pin"]) == ("Auto", "Robot")
    assert all(before != after for before, after in itertools.pairwise(pictures))


def test_explain_names_the_cause_and_the_next_step(shared: Place, ask: Run) -> None:
    eventually(lambda: shared.condition("WorkloadsAvailable").get("status") == "False", "pods that are not ready")
    done = ask("explain", "walker", "--json")
    assert done.exit_code == 1
    problems = {problem["condition"]: problem for problem in json.loads(done.stdout)["problems"]}
    assert problems["Connected"]["reason"] == "NeverConnected"
    assert f"kubectl offload bundle walker -n {shared.namespace}" in problems["Connected"]["step"]
    assert problems["WorkloadsAvailable"]["step"]
    assert all(problem["meaning"] for problem in problems.values())


def test_explain_follows_the_cluster(place: Place, run: Run) -> None:
    addressed(place)

    def available() -> bool:
        report_ready(place.plane, place.namespace)
        return place.condition("WorkloadsAvailable").get("status") == "True"

    eventually(available, "workloads that are available", lambda: place.roff().get("status"))
    problems = json.loads(run("explain", "walker", "--json").stdout)["problems"]
    assert {problem["condition"] for problem in problems} == {"Connected", "ConfigCurrent", "CertificateCurrent"}
    # What Flux, Argo CD and scripts wait for must not hang on a person with a power switch.
    kubectl = place.plane.kubectl(place.namespace)
    kubectl("wait", "--for=condition=Ready", "roff/walker", "--timeout=110s")
    assert run("explain", "walker").exit_code == 0
    [node] = walker()["spec"]["nodes"]
    place.change({"nodes": [node, {**node, "name": "other"}]})  # one output of two nodes
    kubectl("wait", "--for=condition=Stalled", "roff/walker", "--timeout=110s")
    kubectl("wait", "--for=condition=Ready=false", "roff/walker", "--timeout=110s")


def test_an_invalid_specification_is_explained_line_by_line(place: Place, run: Run, tmp_path: Path) -> None:
    twice = walker()
    node = twice["spec"]["nodes"][0]
    twice["spec"]["nodes"].append({**node, "name": "other"})  # one output of two nodes: only the operator finds that
    place.create(ROBOT_OFFLOAD, twice)
    place.wait_condition("SpecValid", "False")
    done = run("explain", "walker")
    assert done.exit_code == 1
    assert "spec.nodes[1].outputs[0].topic" in done.stdout
    refused = run("bundle", "walker", "-o", str(tmp_path / "out"), "--timeout", "60s")
    assert refused.exit_code in (1, 2)
    assert not (tmp_path / "out").exists()


# -- bundle -----------------------------------------------------------------------------------------------------------


def test_a_bundle_is_complete_and_its_key_private(shared: Place, ask: Run, tmp_path: Path) -> None:
    roff = shared.roff()
    out = tmp_path / "walker"
    done = ask("bundle", "walker", "-o", str(out))
    assert done.exit_code == 0, done.output
    files = {str(file.relative_to(out)) for file in out.rglob("*") if file.is_file()}
    assert {"agent.yaml", "environment", "README.md", "compose.yaml", "certificates/ca.pem", PRIVATE_KEY} <= files
    assert stat.S_IMODE((out / PRIVATE_KEY).stat().st_mode) == 0o600
    parameters = yaml.safe_load((out / "agent.yaml").read_text())["/**"]["ros__parameters"]
    assert parameters["uid"] == roff["metadata"]["uid"]
    port = next(each["port"] for each in roff["status"]["endpoints"] if each["purpose"] == "pulse")
    assert parameters["link"]["pulse_endpoints"] == [f"quic/robots.example.com:{port}"]
    kept = base64.b64decode(shared.there(SECRET, "walker-robot")["data"]["tls.crt"])
    assert (out / "certificates" / "robot.pem").read_bytes() == kept
    images = yaml.safe_load((out / "compose.yaml").read_text())["services"]["agent"]["image"]
    assert images == "registry.example/agent:1"  # what runs in the cloud, not what this program would install
    assert "BEGIN" not in done.output
    again = ask("bundle", "walker", "-o", str(out))
    assert again.exit_code == 0, again.output


def test_a_foreign_folder_is_refused(shared: Place, ask: Run, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("chapter 1")
    refused = ask("bundle", "walker", "-o", str(tmp_path))
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_without_an_address_the_bundle_waits_and_then_says_why(place: Place, run: Run, tmp_path: Path) -> None:
    place.create(ROBOT_OFFLOAD, walker())  # a load balancer that nobody provides here
    place.wait_condition("CertificatesReady", "True")
    # Time for a second look, also where the first one takes seconds.
    done = run("bundle", "walker", "-o", str(tmp_path / "out"), "--timeout", "8s")
    assert done.exit_code == 1
    assert "AddressPending" in done.stderr
    assert "Waiting (AddressPending)" in done.stderr
    assert not (tmp_path / "out").exists()
    assert "offload explain" not in done.stderr.partition("Next:")[2]
    message = place.wait_condition("AddressesReady", "False", "AddressPending")["message"]
    assert "load balancer" in message
    assert place.condition("Ready")["status"] == "False"
    explained = run("explain", "walker")
    assert explained.exit_code == 1
    about_the_address = explained.stdout.partition("AddressPending")[2].partition("\n\n")[0]
    assert about_the_address
    assert "offload bundle" not in about_the_address


def test_the_bundle_comes_as_soon_as_the_load_balancer_answers(place: Place, run: Run, tmp_path: Path) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.wait_condition("CertificatesReady", "True")
    for service in ("walker-udp", "walker-tcp"):
        kind_path = f"/api/v1/namespaces/{place.namespace}/services/{service}/status"
        status = {"status": {"loadBalancer": {"ingress": [{"ip": "203.0.113.7"}]}}}
        place.plane.request("PATCH", kind_path, status, "application/merge-patch+json")
    done = run("bundle", "walker", "-o", str(tmp_path / "out"), "--timeout", "60s")
    assert done.exit_code == 0, done.output
    assert "quic/203.0.113.7:7447" in (tmp_path / "out" / "agent.yaml").read_text()


# -- pin and revoke ---------------------------------------------------------------------------------------------------


def test_pin_changes_one_field_and_says_so(place: Place, run: Run) -> None:
    addressed(place)
    before = place.roff()
    done = run("pin", "walker", "robot")
    assert done.exit_code == 0, done.output
    after = place.roff()
    assert after["spec"]["switching"]["pin"] == "Robot"
    before["spec"]["switching"]["pin"] = "Robot"
    assert after["spec"] == before["spec"]
    assert "kubectl-offload" in {entry["manager"] for entry in after["metadata"]["managedFields"]}
    assert after["metadata"]["generation"] == before["metadata"]["generation"] + 1
    run("pin", "walker", "robot")
    assert place.roff()["metadata"]["generation"] == after["metadata"]["generation"]
    assert run("pin", "walker", "auto").exit_code == 0
    assert place.roff()["spec"]["switching"]["pin"] == "Auto"


def test_after_a_revocation_the_next_bundle_has_a_new_key_of_a_new_authority(
    place: Place, run: Run, tmp_path: Path
) -> None:
    addressed(place)
    out = tmp_path / "walker"
    assert run("bundle", "walker", "-o", str(out)).exit_code == 0
    old_key, old = (out / PRIVATE_KEY).read_bytes(), (out / "certificates" / "robot.pem").read_bytes()
    assert run("revoke", "walker").exit_code == 2  # nobody is there to be asked
    done = run("revoke", "walker", "--yes")
    assert done.exit_code == 0, done.output
    assert run("bundle", "walker", "-o", str(out), "--timeout", "60s").exit_code == 0
    assert (out / PRIVATE_KEY).read_bytes() != old_key
    assert serial((out / "certificates" / "robot.pem").read_bytes()) != serial(old)


# -- doctor and mistakes ----------------------------------------------------------------------------------------------


def test_doctor_looks_at_cluster_and_resource(shared: Place, ask: Run) -> None:
    done = ask("doctor", "walker", "--json")
    assert done.exit_code == 1  # the operator runs beside the cluster here, not as a Deployment in it
    levels = {finding["check"]: finding["level"] for finding in json.loads(done.stdout)}
    assert levels["KubernetesVersion"] == "ok"
    assert levels["Definition"] == "ok"
    assert levels["Operator"] == "error"
    assert levels["Addresses"] == "ok"
    assert levels["Certificate"] == "ok"
    assert levels["Connected"] == "error"
    assert levels["Network"] == "warning"  # robots.example.com does not answer
    assert all(finding["step"] for finding in json.loads(done.stdout) if finding["level"] in ("error", "warning"))


def test_a_name_that_is_wrong_is_told_with_the_right_one(shared: Place, ask: Run) -> None:
    for command in (("status", "walkr"), ("explain", "walkr"), ("pin", "walkr", "robot"), ("doctor", "walkr")):
        done = ask(*command)
        assert (done.exit_code, done.stdout) == (2, "")
        assert "did you mean walker?" in done.stderr


def test_somebody_without_rights_learns_which_one_is_missing(
    shared: Place, control_plane: ControlPlane, tmp_path: Path
) -> None:
    weak = str(control_plane.kubeconfig_of(shared.namespace, "default"))
    done = CliRunner().invoke(app, ["status", "--kubeconfig", weak, "-n", shared.namespace])
    assert done.exit_code == 1
    assert "robotoffloads" in done.stderr
    assert "forbidden" in done.stderr


def test_the_definition_that_the_program_prints_is_accepted(kubectl: Kubectl) -> None:
    printed = CliRunner().invoke(app, ["crd"]).stdout
    kubectl("apply", "--server-side", "--force-conflicts", "--dry-run=server", "-f", "-", stdin=printed)
