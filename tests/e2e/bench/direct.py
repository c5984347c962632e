"""DDS alone between a machine in the cluster's network and a pod: no agents, the same programs, the same wire."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from robot_offload_lab.bench.kinds import KINDS
from robot_offload_lab.judge import recording
from robot_offload_lab.judge.measures import Measures, measure
from robot_offload_lab.judge.recording import RunInfo
from robot_offload_lab.run.system import NODE_PRIORITY, RECORDER_PRIORITY
from robot_offload_lab.wire.loop import steady_s
from tests.e2e.consumer import Consumer
from tests.e2e.images import APP
from tests.e2e.story import Story
from tests.e2e.waiting import eventually

DOMAIN: Final = "77"
ECHO: Final = "echo"
SOURCE: Final = "robot_offload_lab.bench.parts.kinds_source"


class Direct:
    """A context manager: leaving it ends what runs outside the cluster; the namespace goes with its story."""

    def __init__(self, story: Story) -> None:
        self._story = story
        self.host = story.host("direct", neighbour=True)
        self._folder: Path = story.folder / "direct"
        self._source: subprocess.Popen[bytes] | None = None
        self._consumer: Consumer | None = None

    def __enter__(self) -> Self:
        self._folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._consumer:
            self._consumer.kill()
        if self._source:
            self._source.kill()
            self._source.wait()

    def start(self) -> None:
        """The echo in a pod, publishers and recorder on the machine; returns when everything comes back."""
        self._story.kubectl.apply(_echo(self._story.images.references[APP], self.host.address))
        address = eventually(self._address, "the address of the echo's pod")
        environment = self._environment(address)
        command = [sys.executable, "-m", SOURCE]
        self._source = self.host.start(command, environment, self._folder / "source.log", priority=NODE_PRIORITY)
        file, topics = self._folder / "recording.jsonl", {kind.returned: kind.type for kind in KINDS}
        child = self.host.start(
            Consumer.command(file, topics, None), environment, self._folder / "recorder.log", piped=True,
            priority=RECORDER_PRIORITY,
        )  # fmt: skip
        self._consumer = consumer = Consumer(child, file, tuple(topics), 0.0)
        consumer.until(lambda: not consumer.watch.missing(), "all ten topics back", 90.0, consumer.watch.missing)

    def rest(self, seconds: float) -> None:
        """Lets time pass."""
        assert self._consumer is not None
        self._consumer.rest(seconds)

    def begin(self) -> float:
        """From now on it counts; returns the moment."""
        assert self._consumer is not None
        start_s = steady_s()
        self._consumer.begin(RunInfo("direct", 0, start_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        return start_s

    def finish(self) -> Measures:
        """Ends the recording and measures it."""
        assert self._consumer is not None
        self._consumer.end(steady_s())
        return measure(recording.read(self._consumer.file))

    def _address(self) -> str:
        pod = self._story.kubectl.json("get", "pod", ECHO)
        return str(pod["status"].get("podIP", ""))

    def _environment(self, peer: str) -> dict[str, str]:
        return {
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "HOME": str(self._folder),
            "ROS_DOMAIN_ID": DOMAIN,
            "ROS_STATIC_PEERS": peer,
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
            "ROS_LOG_DIR": str(self._folder / "ros"),
            "PYTHONUNBUFFERED": "1",
        }


def _echo(image: str, peer: str) -> dict[str, Any]:
    """A pod as the restricted level wants it."""
    variables = {
        "ROS_DOMAIN_ID": DOMAIN,
        "ROS_STATIC_PEERS": peer,
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "HOME": "/tmp",
    }
    container = {
        "name": ECHO,
        "image": image,
        "imagePullPolicy": "IfNotPresent",
        "command": ["python3", "-m", "robot_offload_lab.bench.parts.echo", "--ros-args", "-p", "by_itself:=true"],
        "env": [{"name": name, "value": value} for name, value in variables.items()],
        "securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}},
        "volumeMounts": [{"name": "tmp", "mountPath": "/tmp"}],
    }
    spec = {
        "containers": [container],
        "volumes": [{"name": "tmp", "emptyDir": {}}],
        "terminationGracePeriodSeconds": 1,
        "automountServiceAccountToken": False,
        "securityContext": {"runAsNonRoot": True, "runAsUser": 1000, "seccompProfile": {"type": "RuntimeDefault"}},
    }
    return {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": ECHO}, "spec": spec}
