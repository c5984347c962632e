"""An upgrade of the operator: new images for all robots, a few robots at a time, discovery servers one by one.

Deployments, StatefulSets and their pods are the API server's and its controllers' own; only the kubelet is pretended.
"""

from __future__ import annotations

import datetime
import re
import threading
import urllib.error
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from robot_offload.kube.kinds import POD, ROBOT_OFFLOAD
from robot_offload.objects.labels import COMPONENT, INSTANCE
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import Manifest, Place, eventually, walker
from tests.integration.operator_process import Operator

pytestmark = pytest.mark.api
ROBOTS = tuple(f"walker{number}" for number in range(5))
AT_ONCE = 2
PODS = 4
"""Of each robot: the agent, a node and two discovery servers."""
START_S = 0.4
"""So long a pretended pod needs to become ready."""


class PretendedKubelet:
    """Makes every pod ready a moment after it was made, and notes how many robots are not served at any time."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._ended = threading.Event()
        self.starts_pods = threading.Event()
        self.starts_pods.set()
        self.counting = False
        self.driving = ""
        """A robot whose cloud acts, and which renews its Lease all the time."""
        self.down: list[frozenset[str]] = []
        self.servers_down: list[int] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join(60)

    def _run(self) -> None:
        while not self._ended.wait(START_S):
            if self.driving:
                self._place.renew("cloud", "LinkGood", name=self.driving)
            pods = self._place.list(POD)  # one moment of all robots
            if self.counting:
                self._count(pods)
            for pod in pods:
                if not self.starts_pods.is_set():
                    break
                if not _is_ready(pod) and "deletionTimestamp" not in pod["metadata"]:
                    self._make_ready(pod["metadata"]["name"])

    def _make_ready(self, name: str) -> None:
        now = f"{datetime.datetime.now(datetime.UTC):%Y-%m-%dT%H:%M:%SZ}"
        conditions = [
            {"type": kind, "status": "True", "lastTransitionTime": now} for kind in ("Ready", "ContainersReady")
        ]
        try:
            self._place.patch(POD, name, {"status": {"phase": "Running", "conditions": conditions}}, "status")
        except urllib.error.HTTPError as error:
            error.close()  # it holds the connection
            if error.code != 404:  # gone meanwhile
                raise

    def _count(self, pods: Sequence[Manifest]) -> None:
        ready = Counter(pod["metadata"]["labels"][INSTANCE] for pod in pods if _is_ready(pod))
        servers = Counter(
            pod["metadata"]["labels"][INSTANCE]
            for pod in pods
            if _is_ready(pod) and pod["metadata"]["labels"][COMPONENT] == "discovery"
        )
        self.down.append(frozenset(robot for robot in ROBOTS if ready[robot] < PODS))
        self.servers_down.append(max(2 - servers[robot] for robot in ROBOTS))


def _is_ready(pod: Manifest) -> bool:
    conditions = pod.get("status", {}).get("conditions") or ()
    return any(each["type"] == "Ready" and each["status"] == "True" for each in conditions)


@pytest.fixture
def place(control_plane: ControlPlane, namespace: str) -> Place:
    return Place(control_plane, namespace)


@pytest.fixture
def kubelet(place: Place) -> Iterator[PretendedKubelet]:
    kubelet = PretendedKubelet(place)
    yield kubelet
    kubelet.close()


def images(version: str) -> dict[str, str]:
    names = ("AGENT", "OPERATOR", "DISCOVERY", "ROUTER")
    return {f"{name}_IMAGE": f"registry.example/{name.lower()}:{version}" for name in names}


def images_of(place: Place, robot: str) -> set[str]:
    """The images of ours that a robot's workloads run."""
    found = set()
    for (kind, _), child in place.children(robot).items():
        if kind in ("Deployment", "StatefulSet"):
            containers: list[dict[str, Any]] = child["spec"]["template"]["spec"]["containers"]
            found |= {each["image"] for each in containers if "talker" not in each["image"]}
    return found


def test_an_upgrade_replaces_few_robots_at_once_and_never_both_discovery_servers(
    place: Place, kubelet: PretendedKubelet, control_plane: ControlPlane, tmp_path: Path
) -> None:
    more = {"MAX_ROLLING": str(AT_ONCE), "WATCH_NAMESPACE": place.namespace}
    before = Operator.start(control_plane.kubeconfig, tmp_path / "before.log", **more, **images("1"))
    try:
        for robot in ROBOTS:
            place.create(ROBOT_OFFLOAD, walker(robot))
        for robot in ROBOTS:
            place.wait_condition("WorkloadsAvailable", "True", name=robot)
        kubelet.driving = ROBOTS[0]
        eventually(lambda: place.roff(ROBOTS[0])["status"].get("placement") == "Cloud", "a robot that its cloud drives")
    finally:
        assert before.stop() == 0
    kubelet.counting = True
    after = Operator.start(control_plane.kubeconfig, tmp_path / "after.log", **more, **images("2"))
    try:
        for robot in ROBOTS:
            eventually(
                lambda robot=robot: all(image.endswith(":2") for image in images_of(place, robot)),
                f"the new images of {robot}",
            )
        for robot in ROBOTS:
            place.wait_condition("WorkloadsAvailable", "True", name=robot)
    finally:
        assert after.stop() == 0
    assert {robot for down in kubelet.down for robot in down} == set(ROBOTS)  # each was seen while it was replaced
    assert max(len(down) for down in kubelet.down) <= AT_ONCE
    first = {robot: next(number for number, down in enumerate(kubelet.down) if robot in down) for robot in ROBOTS}
    assert first[ROBOTS[0]] == max(first.values()), "who loses nothing goes first"
    assert max(kubelet.servers_down) == 1


def passes(operator: Operator) -> float:
    """How many passes over objects have gone well."""
    line = re.search(
        r'^robot_offload_reconciles_total\{result="ok"\} (.*)$', operator.ask("metrics", "/metrics")[1], re.M
    )
    return float(line[1]) if line else 0.0


def test_a_new_operator_knows_whose_turn_it_was(
    place: Place, kubelet: PretendedKubelet, control_plane: ControlPlane, tmp_path: Path
) -> None:
    more = {"MAX_ROLLING": str(AT_ONCE), "WATCH_NAMESPACE": place.namespace}

    def begin(version: str, log: str) -> Operator:
        return Operator.start(control_plane.kubeconfig, tmp_path / log, **more, **images(version))

    def waiting() -> list[str]:
        found = [(robot, place.condition("ResourcesApplied", name=robot)) for robot in ROBOTS]
        return [robot for robot, condition in found if condition.get("reason") == "WaitingForTurn"]

    operator = begin("1", "before.log")
    for robot in ROBOTS:
        place.create(ROBOT_OFFLOAD, walker(robot))
    for robot in ROBOTS:
        place.wait_condition("WorkloadsAvailable", "True", name=robot)
    assert operator.stop() == 0
    kubelet.starts_pods.clear()
    kubelet.counting = True
    operator = begin("2", "killed.log")
    try:
        eventually(lambda: len(waiting()) == len(ROBOTS) and len(kubelet.down[-1]) == AT_ONCE, "the first turns")
        operator.kill()
        operator = begin("2", "after.log")
        operator.wait_said("Cache is complete")
        eventually(lambda: passes(operator) >= 2 * len(ROBOTS), "two passes each")
        counted = len(kubelet.down)
        eventually(lambda: len(kubelet.down) >= counted + 3, "what became of that")
        kubelet.starts_pods.set()
        for robot in ROBOTS:
            eventually(
                lambda robot=robot: all(image.endswith(":2") for image in images_of(place, robot)),
                f"the new images of {robot}",
            )
            place.wait_condition("WorkloadsAvailable", "True", name=robot)
    finally:
        assert operator.stop() == 0
    assert max(len(down) for down in kubelet.down) <= AT_ONCE
