"""A real control plane for the tests here: one per run, on free ports, gone (docs/how-to/test-cluster.md)."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Callable, Iterator

import pytest

from robot_offload_lab.cluster import directories, programs
from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.definitions import definitions
from robot_offload_lab.cluster.errors import NoGoError
from tests.integration.chart import OPERATOR, rendered
from tests.integration.operator_cluster import HOME, Place
from tests.integration.operator_process import Operator
from tests.integration.operator_proxy import Proxy

IN_CI = os.environ.get("ROBOT_OFFLOAD_CI") == "1"
PROGRAMS: pytest.StashKey[programs.Programs | NoGoError] = pytest.StashKey()

NewNamespace = Callable[..., str]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Time for busy machines: a generous limit, and a second go, which the summary lists (`RERUN`)."""
    for item in items:
        if item.get_closest_marker("api"):
            item.add_marker(pytest.mark.timeout(900))
            item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Build what the tests need before any test's time limit runs."""
    wanted = any(item.get_closest_marker("api") for item in session.items)
    if not wanted or session.config.option.collectonly:
        return
    terminal = session.config.pluginmanager.getplugin("terminalreporter")

    def say(line: str) -> None:
        if terminal is not None:  # one of several processes (-n 2) has none: `make` has built before
            terminal.write_line(line, flush=True)

    try:
        session.config.stash[PROGRAMS] = programs.ensure(say)
    except NoGoError as error:
        session.config.stash[PROGRAMS] = error


@pytest.fixture(scope="session")
def cluster_programs(request: pytest.FixtureRequest) -> programs.Programs:
    """The built programs; without Go the test is skipped with the reason, in CI it fails."""
    found = request.config.stash.get(PROGRAMS, None)
    if found is None:  # a test without the marker asks for it: its time limit would end the first build
        pytest.fail("A test that uses the control plane carries the marker: pytestmark = pytest.mark.api")
    if isinstance(found, NoGoError):
        if IN_CI:
            pytest.fail(str(found))
        pytest.skip(str(found))
    return found


@pytest.fixture(scope="session")
def control_plane(cluster_programs: programs.Programs) -> Iterator[ControlPlane]:
    """The API server of this run with our CRDs. Tests share it, each in a namespace of its own."""
    with (
        directories.of_this_run() as directory,
        ControlPlane(directory, cluster_programs).running(definitions()) as plane,
    ):
        yield plane


@pytest.fixture(scope="session")
def bare_control_plane(cluster_programs: programs.Programs) -> Iterator[ControlPlane]:
    """Another one, for tests that install our CRDs by themselves; each removes what it has installed."""
    with directories.of_this_run() as directory, ControlPlane(directory, cluster_programs).running() as plane:
        yield plane


@pytest.fixture
def new_namespace(control_plane: ControlPlane, request: pytest.FixtureRequest) -> Iterator[NewNamespace]:
    """Make namespaces: `new_namespace()` or `new_namespace(pod_security="restricted")`; deleted after the test."""
    made: list[str] = []

    def make(pod_security: str = "") -> str:
        made.append(control_plane.new_namespace(_namespace_name(request.node.name), pod_security))
        return made[-1]

    yield make
    for name in made:
        control_plane.request("DELETE", f"/api/v1/namespaces/{name}")


@pytest.fixture
def namespace(new_namespace: NewNamespace) -> str:
    """A namespace for this test alone."""
    return new_namespace()


@pytest.fixture
def restricted_namespace(new_namespace: NewNamespace) -> str:
    """One that takes only pods of the `restricted` pod security standard."""
    return new_namespace(pod_security="restricted")


@pytest.fixture
def kubectl(control_plane: ControlPlane, namespace: str) -> Kubectl:
    """Kubectl in this test's namespace."""
    return control_plane.kubectl(namespace)


@pytest.fixture
def helm(control_plane: ControlPlane, namespace: str) -> Helm:
    """Helm in this test's namespace."""
    return control_plane.helm(namespace)


def _namespace_name(test: str) -> str:
    readable = re.sub(r"[^a-z0-9]+", "-", test.removeprefix("test_").lower())[:40].strip("-")
    return f"{readable}-{secrets.token_hex(3)}"


@pytest.fixture(scope="session")
def account(control_plane: ControlPlane) -> str:
    """The token of an operator with the rights that the chart gives it, and no others."""
    templates = ("--show-only", "templates/serviceaccount.yaml", "--show-only", "templates/rbac.yaml")
    kubectl = control_plane.kubectl(HOME)
    kubectl.apply(*rendered(control_plane.helm(HOME), {"certManager.enabled": True}, *templates))
    return kubectl("create", "token", OPERATOR, "--duration=24h").strip()


@pytest.fixture(scope="module")
def proxy(control_plane: ControlPlane, account: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    proxy = Proxy(control_plane, tmp_path_factory.mktemp("proxy"), account)
    yield proxy
    proxy.close()


@pytest.fixture(scope="module")
def operator(proxy: Proxy, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Operator]:
    operator = Operator.start(proxy.account, tmp_path_factory.mktemp("operator") / "log")
    operator.wait_said("Became leader")
    yield operator
    assert operator.stop() == 0
    assert not [line for line in operator.lines() if line["event"] == "Reconcile failed"]


@pytest.fixture
def place(control_plane: ControlPlane, namespace: str, operator: Operator) -> Place:
    return Place(control_plane, namespace)
