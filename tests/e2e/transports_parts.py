"""What the stories about transports and isolation share: a small application, and participants that come new."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from robot_offload_lab.judge.recording import Arrival
from robot_offload_lab.judge.streams import quantile
from tests.e2e.figures import figure
from tests.e2e.images import APP
from tests.e2e.judged import assert_faultless
from tests.e2e.robot import Robot
from tests.e2e.story import Manifest, Story

APPS: Final = Path(__file__).parent / "apps"
OUTPUT: Final = "/tick"
SAMPLES: Final = 100
"""Messages from which the figures of a transport are taken."""
PATIENCE_S: Final = 60.0
"""For a participant that comes new and shall meet others: on a busy machine it starts for ten seconds."""
IN_VAIN_S: Final = 15.0
"""How long somebody listens who shall hear nothing."""
CALM: Final[Manifest] = {
    "heartbeatPeriod": "50ms",
    "lossTimeout": "790ms",
    "lease": "2s",
    "maxCommandAge": "800ms",
    "latency": {"robotPeriod": "200ms", "cloudPeriod": "100ms", "tolerance": "500ms"},
    "activationDeadline": "3s",
    "maxClockOffset": "200ms",
}
"""Switching that a machine which stands still for a moment does not disturb: these stories are about who is heard."""


def ticking(name: str, transport: Mapping[str, Any], image: str, *, says: str = "") -> Manifest:
    """A RobotOffload with one duplicated node that publishes stamps, and one in the cloud that answers.

    Args:
        name: of the resource.
        transport: the block of that name.
        image: of its pods.
        says: what the answering node calls itself; the resource's name when left out.
    """
    nodes = [
        {
            "name": "ticker",
            "placement": "Duplicated",
            "image": image,
            "run": {"command": ["python3", "ticker.py"]},
            "outputs": [{"topic": OUTPUT, "type": "geometry_msgs/msg/TwistStamped", "rate": 10}],
        },
        {
            "name": "answering",
            "placement": "Cloud",
            "lifecycle": False,
            "image": image,
            "run": {"command": ["python3", "answering.py"], "parameters": {"place": "cloud", "says": says or name}},
        },
    ]
    return {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": name},
        "spec": {"robot": {"domainID": 7}, "transport": dict(transport), "nodes": nodes, "switching": CALM},
    }


def application(story: Story, name: str, transport: Mapping[str, Any]) -> Manifest:
    """`ticking` with the image of this cluster."""
    return ticking(name, transport, story.images.references[APP])


def carry(manifest: Manifest, transport: str, address: str) -> Manifest:
    """The manifest with another transport, for a robot that the pods can reach.

    Args:
        manifest: changed in place.
        transport: `DiscoveryServer` or `StaticPeers`.
        address: of the robot.
    """
    spec = manifest["spec"]
    if transport == "StaticPeers":
        spec["transport"] = {"type": transport, "staticPeers": {"robot": [address]}}
        # Among each other the pods find themselves by multicast, which this cluster carries within a node only.
        spec["cloud"] = {"nodeSelector": {"kubernetes.io/hostname": "node1"}}
    else:
        spec["transport"] = {"type": transport}
    return manifest


def to_the_cloud(robot: Robot, delay_ms: float, label: str) -> None:
    """Starts everything on a robot and lets the cloud act for a while; prints the figures of the transport.

    Args:
        robot: nothing runs on it yet.
        delay_ms: of the robot's wire from now on, one way.
        label: of the figures.
    """
    robot.host.wire.set(delay_ms=delay_ms)
    robot.listen()
    robot.begin()
    robot.start_nodes()
    started_s = robot.start_agent()
    robot.until_site("cloud")
    robot.until(lambda: robot.heard("cloud") > 0, "a message from the cloud", PATIENCE_S)
    first = in_charge(robot, delay_ms, label)
    figure(f"{label}: robot start to first cloud message", first.t_s - started_s, "s")


def in_charge(robot: Robot, delay_ms: float, label: str) -> Arrival:
    """Listens to the cloud for a while, ends the recording, prints what the transport added to the wire's delay.

    Returns:
        The recording's first message from the cloud.
    """
    heard = robot.heard("cloud")
    robot.until(lambda: robot.heard("cloud") >= heard + SAMPLES, f"{SAMPLES} messages from the cloud", PATIENCE_S)
    measures = robot.finish()
    arrivals = [each for each in measures.recording.outputs[OUTPUT] if each.site == "cloud"]
    ages = [each.age_s * 1e3 - delay_ms for each in arrivals]
    figure(f"{label}: added to the wire's {delay_ms:g} ms p50", quantile(ages, 0.5), "ms")
    figure(f"{label}: added to the wire's {delay_ms:g} ms p99", quantile(ages, 0.99), "ms")
    assert_faultless(measures)
    return arrivals[0]


# -- participants that come new ---------------------------------------------------------------------------------------


def asked_on(robot: Robot, place: str, *, patience_s: float = PATIENCE_S) -> dict[str, Any]:
    """What a new participant on the robot gets from `/PLACE`, by kind."""
    command = [sys.executable, str(APPS / "asking.py"), place, "--patience", str(patience_s)]
    return _told(robot, command, robot.environment(), patience_s)


def asked_in(
    story: Story,
    pod: str,
    place: str,
    *,
    patience_s: float = PATIENCE_S,
    environment: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """What a new participant in a pod gets from `/PLACE`, by kind.

    Args:
        story: whose pod it is.
        pod: its name; its image is that of the example nodes.
        place: see `asking.py`.
        patience_s: how long it asks.
        environment: laid over the pod's own, for participants that are where they do not belong.
    """
    own = [f"{key}={value}" for key, value in (environment or {}).items()]
    command = ["env", *own, "python3", "/app/asking.py", place, "--patience", str(patience_s)]
    found: dict[str, Any] = json.loads(story.kubectl("exec", pod, "--", *command).splitlines()[-1])
    return found


def knocked(robot: Robot, of: Robot, *options: str) -> dict[str, Any]:
    """What a program on a robot's machine gets that shows the robot's own certificate to a robot's cloud.

    Args:
        robot: whose machine and certificate.
        of: whose cloud.
        options: of `knocking.py`.
    """
    door = robot.folder / f"door-of-{of.name}.yaml"
    own, theirs = str(robot.place / "certificates"), str(of.place / "certificates")
    # Everything as the other robot has it, also by whom it knows its cloud, but for what it proves itself with.
    door.write_bytes(
        (of.bundle / "agent.yaml").read_bytes().replace(theirs.encode(), str(of.bundle / "certificates").encode())
    )
    command = [sys.executable, str(APPS / "knocking.py"), str(door), own, *options]
    return _told(robot, command, robot.environment(), PATIENCE_S)


def _told(robot: Robot, command: Sequence[str], environment: Mapping[str, str], patience_s: float) -> dict[str, Any]:
    log = robot.folder / "participants.log"
    child = robot.host.start(command, environment, log, piped=True)
    try:
        text, _ = child.communicate(timeout=patience_s + PATIENCE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        raise
    assert child.returncode == 0, f"{command[1]} failed:\n{log.read_text()[-2000:]}"
    found: dict[str, Any] = json.loads(text)
    return found


def said(got: Mapping[str, Any]) -> dict[str, object]:
    """The answers of `asked_on` or `asked_in` without their times."""
    return {kind: each["answer"] for kind, each in got.items()}


def answers_of(name: str) -> dict[str, object]:
    """What everybody gets who meets an answering node of this name."""
    return {"topic": name, "service": name, "action": [0, 1, 1, 2, 3, 5, 8, 13]}


@contextmanager
def answering_on(robot: Robot, place: str) -> Iterator[None]:
    """A new node on the robot that answers under `/PLACE`; it calls itself by the place."""
    arguments = ["--ros-args", "-p", f"place:={place}", "-p", f"says:={place}"]
    command = [sys.executable, str(APPS / "answering.py"), *arguments]
    child = robot.host.start(command, robot.environment(), robot.folder / f"answering-{place}.log")
    try:
        yield
    finally:
        child.terminate()
        child.wait()


def pod_of(story: Story, name: str, node: str) -> str:
    """The pod of a node of the application."""
    found = [str(pod["metadata"]["name"]) for pod in story.pods(name, "node")]
    return next(each for each in found if each.startswith(f"{name}-{node}"))
