"""Clusters of kind, as far as nothing is started: the choice, what kind and Docker are told, what is removed."""

from __future__ import annotations

import ipaddress
import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload_lab.cluster import (
    choice,
    kind_cluster,
    kind_docker,
    kind_image,
    layout,
    load_balancer,
    netns,
    ownership,
    preflight,
)
from robot_offload_lab.cluster.errors import ClusterError, NotHereError
from robot_offload_lab.cluster.kind_cluster import KindCluster
from robot_offload_lab.cluster.kind_config import configuration
from robot_offload_lab.cluster.kind_layout import MOST_NODES, KindLayout
from robot_offload_lab.cluster.kind_node import KindNode
from robot_offload_lab.cluster.kind_plane import KindPlane
from robot_offload_lab.cluster.programs import Programs

LAYOUT = KindLayout(3)
Docker = Callable[..., Path]


@pytest.fixture
def docker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Docker:
    """Installs a docker that writes down what it is asked and then does what it is told; the file of its questions."""
    monkeypatch.setattr(layout, "STATE", tmp_path / "state")
    LAYOUT.home.mkdir(parents=True)

    def install(*lines: str) -> Path:
        program, asked = tmp_path / "docker", tmp_path / "asked"
        program.write_text("\n".join(["#!/bin/sh", f'echo "$@" >> {asked}', *lines]) + "\n")
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
        return asked

    return install


# -- the choice -------------------------------------------------------------------------------------------------------


@pytest.fixture
def possible(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both kinds of cluster can run here."""
    monkeypatch.delenv(choice.CHOSEN, raising=False)
    monkeypatch.setattr(preflight, "preflight", lambda: None)
    monkeypatch.setattr(kind_cluster, "missing", lambda: None)


def test_where_docker_answers_the_cluster_is_one_of_kind(possible: None) -> None:
    assert choice.choose() == choice.Choice(kind=True, why="Docker answers", missing=None)


def test_otherwise_it_is_our_own_and_the_reason_is_told(possible: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kind_cluster, "missing", lambda: "There is no Docker. Next: install it.")
    chosen = choice.choose()
    assert not chosen.kind
    assert str(chosen) == "cluster: our own, because kind cannot be used: There is no Docker."


@pytest.mark.parametrize(("word", "kind"), [("own", False), ("kind", True), ("auto", True), ("", True)])
def test_the_environment_has_the_last_word(
    possible: None, monkeypatch: pytest.MonkeyPatch, word: str, kind: bool
) -> None:
    monkeypatch.setenv(choice.CHOSEN, word)
    assert choice.choose().kind == kind


def test_a_kind_that_was_asked_for_and_cannot_run_is_missed_not_replaced(
    possible: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(choice.CHOSEN, "kind")
    monkeypatch.setattr(kind_cluster, "missing", lambda: "no Docker")
    chosen = choice.choose()
    assert chosen.kind
    assert chosen.missing == "no Docker"


def test_any_other_word_is_refused(possible: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(choice.CHOSEN, "minikube")
    with pytest.raises(ClusterError, match="minikube: use own, kind or auto"):
        choice.choose()


def test_who_is_not_root_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert "run it with sudo" in str(kind_cluster.missing())


@pytest.mark.parametrize(
    ("does", "said"),
    [
        (["echo 27.0"], ""),
        (["echo nobody is there >&2", "exit 1"], "Docker does not answer (nobody is there)"),
        (["echo", "echo nobody is there >&2"], "Docker does not answer (nobody is there)"),
    ],
)
def test_docker_answers_when_it_tells_its_version(docker: Docker, does: list[str], said: str) -> None:
    docker(*does)
    assert kind_docker.silent() == said


def test_a_machine_without_docker_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert kind_docker.silent() == "there is no command docker"


# -- what kind and Docker are told ------------------------------------------------------------------------------------


def test_docker_gives_nodes_only_addresses_at_which_robots_look_for_them() -> None:
    free = set(map(str, ipaddress.ip_network(LAYOUT.given_by_docker))) - set(LAYOUT.kept_from_docker)
    assert len(free) == MOST_NODES + 1
    assert free <= {LAYOUT.node(each) for each in range(1, layout.MOST_NODES + 1)}
    assert not free & {LAYOUT.host, LAYOUT.router, LAYOUT.api}


def test_kind_gets_one_control_plane_and_the_nodes_with_our_addresses() -> None:
    read = yaml.safe_load(configuration(LAYOUT, 2, fast_failure=True))
    assert [node["role"] for node in read["nodes"]] == ["control-plane", "worker", "worker"]
    assert read["name"] == "rofkind3"
    assert read["networking"]["podSubnet"] == LAYOUT.pods
    assert read["networking"]["serviceSubnet"] == LAYOUT.services


@pytest.mark.parametrize(
    ("fast", "kinds"), [(True, {"KubeletConfiguration", "ClusterConfiguration"}), (False, {"KubeletConfiguration"})]
)
def test_a_dead_node_is_noticed_soon_only_if_wanted(fast: bool, kinds: set[str]) -> None:
    read = yaml.safe_load(configuration(LAYOUT, 1, fast_failure=fast))
    patches = [json.loads(each) for each in read["kubeadmConfigPatches"]]
    assert {each["kind"] for each in patches} == kinds
    assert ("nodeLeaseDurationSeconds" in patches[0]) == fast


def test_the_network_is_ours_by_name_address_and_label(docker: Docker) -> None:
    asked = docker()
    kind_docker.make_network(LAYOUT)
    words = asked.read_text().split()
    assert words[:2] == ["network", "create"]
    assert words[-1] == "rofkind3"
    assert words[words.index("--subnet") + 1] == "10.123.0.0/24"
    assert f"{kind_docker.LABEL}=rofkind3" in words
    assert kind_docker.uses(LAYOUT)


def test_what_somebody_else_has_made_under_our_names_is_refused(docker: Docker) -> None:
    docker('case "$1" in ps) echo rofkind3-control-plane;; esac')
    with pytest.raises(ClusterError, match="rofkind3-control-plane"):
        kind_docker.refuse_strangers(LAYOUT)


def test_a_container_that_fails_is_told_with_its_words(docker: Docker) -> None:
    docker("echo no such container >&2", "exit 1")
    with pytest.raises(ClusterError, match="docker exec node true: no such container"):
        kind_docker.inside("node", "true")


# -- what is removed --------------------------------------------------------------------------------------------------


def test_a_cluster_that_never_used_docker_never_asks_it(docker: Docker) -> None:
    asked = docker()
    kind_docker.remove(LAYOUT)
    assert kind_docker.left(LAYOUT) == 0
    assert not asked.exists()


def test_containers_go_with_their_volumes_and_then_the_network(docker: Docker) -> None:
    asked = docker(
        'case "$1 $2" in "ps "*) echo rofkind3-worker;; "network ls") echo rofkind3;; "info "*) echo 27;; esac'
    )
    kind_docker.make_network(LAYOUT)
    assert kind_docker.left(LAYOUT) == 2
    kind_docker.remove(LAYOUT)
    done = [line for line in asked.read_text().splitlines() if " rm " in f" {line} "]
    assert done == ["rm --force --volumes rofkind3-worker", "network rm rofkind3"]
    assert not kind_docker.uses(LAYOUT)


def test_containers_are_not_forgotten_while_docker_is_silent(docker: Docker) -> None:
    docker('case "$1" in info) exit 1;; esac')
    kind_docker.make_network(LAYOUT)
    with pytest.raises(ClusterError, match="start Docker, then: down"):
        kind_docker.remove(LAYOUT)
    assert kind_docker.uses(LAYOUT)


def test_a_container_that_is_left_counts() -> None:
    nothing = dict.fromkeys(ownership.Leftovers.__slots__, 0)
    assert not ownership.Leftovers(**nothing)
    assert ownership.Leftovers(**nothing | {"containers": 1})


# -- nodes ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def plane(docker: Docker) -> KindPlane:
    return KindPlane(LAYOUT, Programs(Path()))


def test_a_node_has_the_address_that_docker_gave_it_and_learns_the_way_to_robots(
    docker: Docker, plane: KindPlane, monkeypatch: pytest.MonkeyPatch
) -> None:
    docker("echo 10.123.0.12")
    node = KindNode("rofkind3-worker", LAYOUT, plane)
    assert node.address == "10.123.0.12"
    done: list[tuple[object, ...]] = []
    monkeypatch.setattr(netns, "attach", lambda *words: done.append(words))
    monkeypatch.setattr(netns, "ip", lambda *words, netns: done.append((*words, netns)))
    docker('case "$3" in *Pid*) echo 42;; *) echo 10.123.0.13;; esac')
    node.connect()
    assert node.address == "10.123.0.13"
    assert done == [
        ("rof3-rofkind3-worker", 42),
        ("route replace 10.123.0.0/16 via 10.123.0.2", "rof3-rofkind3-worker"),
    ]


def test_an_archive_is_imported_again_only_after_a_change(docker: Docker, plane: KindPlane, tmp_path: Path) -> None:
    asked = docker()
    node = KindNode("rofkind3-worker", LAYOUT, plane)
    archive = tmp_path / "image.tar"
    archive.write_bytes(b"one")
    for _ in range(2):
        node.import_images([archive])
    assert asked.read_text().count("images import") == 1
    archive.write_bytes(b"other")
    node.import_images([archive])
    assert asked.read_text().count("images import") == 2


def test_policies_cannot_be_switched_off(plane: KindPlane) -> None:
    cluster = KindCluster(LAYOUT, plane)
    cluster.enforce_policies(True)
    with pytest.raises(NotHereError, match="cannot be told not to"):
        cluster.enforce_policies(False)


def test_load_balancers_leave_a_control_plane_alone() -> None:
    def node(name: str, address: str, **labels: str) -> dict[str, Any]:
        status = {"conditions": [{"type": "Ready", "status": "True"}]}
        addresses = [{"type": "InternalIP", "address": address}]
        return {"metadata": {"name": name, "labels": labels}, "status": {**status, "addresses": addresses}}

    excluded = {"node.kubernetes.io/exclude-from-external-load-balancers": ""}
    nodes = [node("a-control-plane", "10.123.0.11", **excluded), node("worker", "10.123.0.12")]
    service = {
        "metadata": {"name": "one", "namespace": "ours"},
        "spec": {"type": "LoadBalancer"},
        "status": {"loadBalancer": {"ingress": [{"ip": "10.123.1.10"}]}},
    }
    assert load_balancer.routes([service], [], nodes, {}, LAYOUT) == {"10.123.1.10": "10.123.0.12"}


# -- the image of a node ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "file", "inner"), [("--bundle", "config.json", True), ("--process", "process", False)]
)
def test_runc_is_not_asked_for_what_root_may_not_do(tmp_path: Path, option: str, file: str, inner: bool) -> None:
    status = Path("/proc/self/status").read_text()
    if int(status.partition("CapEff:")[2].split()[0], 16) >> 24 & 1:
        pytest.skip("this process may use CAP_SYS_RESOURCE")
    process = {
        "capabilities": {"bounding": ["CAP_CHOWN", "CAP_SYS_RESOURCE"]},
        "rlimits": [{"type": "RLIMIT_NOFILE"}],
        "oomScoreAdj": -998,
    }
    (tmp_path / file).write_text(json.dumps({"process": process} if inner else process))
    real = tmp_path / "runc"
    real.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/called\n')
    real.chmod(0o755)
    script = Path(kind_image.__file__).with_name("kind_runc.sh")
    place = str(tmp_path) if inner else str(tmp_path / file)
    arguments = ["create", option, place, "one"]
    subprocess.run([str(script), *arguments], env={**os.environ, "RUNC": str(real)}, check=True)
    changed = json.loads((tmp_path / file).read_text())
    changed = changed["process"] if inner else changed
    assert changed == {"capabilities": {"bounding": ["CAP_CHOWN"]}, "oomScoreAdj": 0}
    assert (tmp_path / "called").read_text().split() == arguments


def test_the_image_cannot_be_made_without_docker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kind_docker, "silent", lambda: "there is no command docker")
    with pytest.raises(ClusterError, match="No image of a node can be made: there is no command docker"):
        kind_image.provide(print)
