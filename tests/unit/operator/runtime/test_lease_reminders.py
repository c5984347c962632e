"""A robot that goes on renewing its Lease puts off the moment at which it counts as gone, and nothing else."""

from __future__ import annotations

from typing import Any, cast

from robot_offload.controller.clock import Clock
from robot_offload.controller.memory import Memory
from robot_offload.controller.reconcile import Controller
from robot_offload.decide import presence
from robot_offload.kube.port import KubeApi
from robot_offload.objects.facts import default_images
from robot_offload.runtime.queue import Queue

NAME = ("fleet", "walker")


def lease(number: int) -> dict[str, Any]:
    spec = {
        "holderIdentity": "walker",
        "leaseDurationSeconds": 30,
        "renewTime": f"2026-11-22T10:00:{number:02}.000000Z",
    }
    return {"metadata": {"resourceVersion": str(number)}, "spec": spec}


def test_what_is_due_at_a_time_stays_due_however_often_a_robot_renews() -> None:
    now_s = [0.0]
    clock = Clock(steady_s=lambda: now_s[0])
    controller = Controller(cast("KubeApi", None), default_images("1"), clock)
    memory = controller.memories[NAME] = Memory("uid", status={"robot": {"connected": True}})
    memory.lease = presence.meaning(lease(0))
    memory.sighting = presence.look(presence.look(None, lease(0), 0.0), lease(1), 0.0)
    memory.however_s = 25.0  # its turn of an upgrade, the end of a certificate
    queue: Queue[tuple[str, str]] = Queue(clock.steady_s)
    queue.remind(NAME, 25.0)
    for number in range(2, 5):
        now_s[0] += 8.0
        quiet_s = controller.saw_lease(NAME, lease(number))
        assert quiet_s is not None
        queue.postpone(NAME, quiet_s)
    assert len(queue) == 0
    now_s[0] = 25.0
    assert len(queue) == 1
    memory.however_s = float("inf")
    assert controller.saw_lease(NAME, lease(5)) == 30.0
