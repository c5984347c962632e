"""What stories about faults share: a wheelchair that drives in the cloud, what is done to pods, what became of it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from robot_offload_lab.judge.measures import Measures
from tests.e2e.figures import figure
from tests.e2e.judged import assert_faultless, judged
from tests.e2e.robot import Robot
from tests.e2e.story import READY, Story, state_of_pods
from tests.e2e.waiting import eventually

WHEELCHAIR: Final = "wheelchair"
BACK_S: Final = 120.0
"""For the cloud to act again: pods start, nodes find each other, and nothing is asked of pods that stop for 25 s."""
SETTLED_S: Final = 3.0

Manifest = dict[str, Any]
Pods = dict[str, tuple[str, int]]


def drive(story: Story, change: Callable[[Manifest], None] | None = None) -> Robot:
    """Applies the wheelchair, starts its robot from the bundle, and returns when commands from the cloud arrive.

    Args:
        story: that it belongs to.
        change: is given the manifest to change it in place.
    """
    offload = story.apply(story.sample(WHEELCHAIR, change))
    story.wait_conditions(WHEELCHAIR, *READY)
    robot = story.robot(offload)
    robot.listen()
    robot.begin()
    robot.start_nodes()
    robot.start_agent()
    until_cloud(robot)
    robot.rest(SETTLED_S)
    return robot


def until_cloud(robot: Robot, patience_s: float = BACK_S) -> None:
    """Waits until the cloud is in charge and its commands arrive."""
    robot.until_site("cloud", patience_s)
    heard = robot.heard("cloud")
    robot.until(lambda: robot.heard("cloud") > heard, "a command from the cloud")


def away_and_back(robot: Robot, patience_s: float = BACK_S) -> None:
    """Waits until the robot acts and, after that, the cloud again; some commands of it arrive."""
    heard = robot.heard("robot")
    robot.until_site("robot")
    robot.until(lambda: robot.heard("robot") > heard, "a command of the robot's own")
    until_cloud(robot, patience_s)
    robot.rest(SETTLED_S)


def arrived(robot: Robot, *, asked: int | None = None, but: frozenset[str] = frozenset()) -> Measures:
    """Ends the recording: nothing was doubled, stale or silent for too long; prints how long the cloud was away.

    A busy machine may send the robot home more often than the story does; that is no fault.

    Args:
        robot: that was driven.
        asked: how often pods that were about to end must have asked the robot to take over; None: no matter.
        but: kinds of violations that the story brings about itself.
    """
    measures = judged(robot.finish())
    stays = [stay for site, stay in measures.stays if site == "robot" and stay.start_s > _first_cloud_s(measures)]
    figure("times that the robot took over", len(stays))
    figure("longest time that it acted", max((stay.length_s for stay in stays), default=None), "s")
    home = [each for each in measures.switches if each.after == "robot"]
    gaps = [gap for each in home for gap in each.gap_ms.values() if gap is not None]
    figure("longest silence around a change to the robot", max(gaps, default=None), "ms")
    assert_faultless(measures, but=but)
    found = sum(each.change.reason == "PodStopping" for each in home)
    assert asked in (None, found), f"pods that were about to end asked the robot to take over {found} times"
    return measures


def _first_cloud_s(measures: Measures) -> float:
    return next(stay.start_s for site, stay in measures.stays if site == "cloud")


# -- pods -------------------------------------------------------------------------------------------------------------


def pod_of(story: Story, name: str, component: str) -> Manifest:
    """The one pod of a component, as soon as there is no other one."""

    def alone() -> list[Manifest]:
        pods = story.pods(name, component)
        return pods if len(pods) == 1 else []

    return eventually(alone, f"one pod of {component}", instead=lambda: state_of_pods(story, name))[0]


def births(story: Story, name: str = WHEELCHAIR) -> Pods:
    """By name: the uid of every pod and how often its containers have started again. Equal: nothing was rolled."""
    return {
        pod["metadata"]["name"]: (
            pod["metadata"]["uid"],
            sum(each["restartCount"] for each in pod["status"].get("containerStatuses", [])),
        )
        for pod in story.pods(name)
    }


def kill_container(pod: Manifest, container: str) -> None:
    """SIGKILL for every process of a container, from outside, as the kernel does when memory runs out."""
    pids = pids_of(pod, container)
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    assert pids, f"no process of container {container} was found on this machine"


def kill_process(pids: Callable[[], Iterable[int]], name: str) -> None:
    """SIGKILL for the one process of an agent that has this name."""

    def alone() -> list[int]:
        found = [pid for pid in pids() if _comm(pid).endswith(f"-{name}")]
        return found if len(found) == 1 else []

    [pid] = eventually(alone, f"one process {name}", instead=lambda: [(pid, _comm(pid)) for pid in pids()])
    os.kill(pid, signal.SIGKILL)


def _comm(pid: int) -> str:
    with suppress(OSError):  # a process that has ended meanwhile
        return Path(f"/proc/{pid}/comm").read_text().strip()
    return ""


def pids_of(pod: Manifest, container: str) -> list[int]:
    """The processes of a container, as this machine numbers them."""
    status = next(each for each in pod["status"]["containerStatuses"] if each["name"] == container)
    identity = status["containerID"].rpartition("/")[2]
    assert identity, f"{container} does not run: {status}"
    found = []
    for path in Path("/proc").glob("[0-9]*/cgroup"):
        with suppress(OSError):  # a process that has ended meanwhile
            if identity in path.read_text():
                found.append(int(path.parent.name))
    return found


def delete_pod(story: Story, pod: Manifest, *options: str) -> None:
    """`kubectl delete pod`, in whatever namespace it is."""
    metadata = pod["metadata"]
    story.kubectl.within(metadata["namespace"])("delete", "pod", metadata["name"], "--wait=false", *options)


def gone(story: Story, pod: Manifest) -> bool:
    """Whether the API server knows this very pod no more."""
    metadata = pod["metadata"]
    pods = story.kubectl.within(metadata["namespace"]).json("get", "pods")["items"]
    return all(each["metadata"]["uid"] != metadata["uid"] for each in pods)


def wait_gone(story: Story, pod: Manifest, patience_s: float = 90.0) -> None:
    """Waits until a pod is gone for good."""
    eventually(lambda: gone(story, pod), f"the end of pod {pod['metadata']['name']}", patience_s=patience_s)
