"""Pods of one node share the calls of its services: real servers come, go and die while clients call."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from std_srvs.srv import Trigger

from robot_offload.render import pool
from tests.ros.agent.clients import until
from tests.ros.agent.harness import World
from tests.ros.agent.test_services import Caller

SERVER = Path(__file__).with_name("pool_server.py")


class Pool:
    """The pods of a pool, started as the operator starts them."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.pods: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, pod: str) -> None:
        words = (sys.executable, str(SERVER), "--ros-args", "-r", "/share:=/offload/cloud/pod_this/share")
        environment = {"ROS_DOMAIN_ID": str(self.world.domain["cloud"]), pool.POD_VARIABLE: pod}
        command = [sys.executable, *pool.named(words)[1:]]
        self.pods[pod] = self.world.processes.start(f"pod-{pod}", command, environment=environment)

    def leave(self, pod: str) -> None:
        """The pod is told to end: it ends when the relay says that its calls are answered."""
        runtime, member = self.world.folder / "cloud", f"pod_{pod.replace('-', '_')}"
        (runtime / "leaving").mkdir(exist_ok=True)
        (runtime / "leaving" / member).touch()
        until((runtime / "left" / member).exists, f"{pod} may go")
        self.pods[pod].terminate()
        self.pods[pod].wait()

    def close(self) -> None:
        for process in self.pods.values():
            process.kill()
            process.wait()


@pytest.fixture
def pods(serving_world: World) -> Iterator[Pool]:
    made = Pool(serving_world)
    yield made
    made.close()


def answerers(caller: Caller, start: int = 0) -> set[str]:
    """Return the pods that have answered calls from a number on."""
    return {answers[0].message for number, answers in caller.answers.items() if number >= start}


def test_no_call_is_lost_while_a_pool_grows_and_shrinks(serving_world: World, pods: Pool) -> None:
    pods.start("planner-a")
    client = serving_world.ear.node.create_client(Trigger, "/share")
    until(client.service_is_ready, "the relay of the robot")
    serving_world.ear.node.destroy_client(client)
    until(lambda: "/share" in up(serving_world), "the first pod serves")
    share = Caller(serving_world.ear, Trigger, "/share")
    try:
        share.more()
        assert answerers(share) == {"planner-a"}
        for pod in ("planner-b", "planner-c"):
            pods.start(pod)
        until(lambda: len(answerers(share)) == 3, "answers of three pods")
        pods.leave("planner-a")
        gone = share.asked
        share.more(20)
        until(lambda: share.answers.keys() >= set(range(gone, gone + 10)), "calls after the end of a pod")
        share.stop()
        until(lambda: len(share.answers) == share.asked, "an answer to every call")
        assert "planner-a" not in answerers(share, gone)
        assert all(len(answers) == 1 and answers[0].success for answers in share.answers.values())
    finally:
        share.close()


def up(world: World) -> list[str]:
    """Return the services under the names of pods in the cloud."""
    names = [name for name, _ in world.cloud_ear().node.get_service_names_and_types()]
    return [name[name.index("/share") :] for name in names if name.startswith("/offload/cloud/pod_")]
