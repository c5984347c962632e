"""The RobotOffload that a measurement runs: one light lifecycle node on both sides, and sensors that it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload_lab.wire.options import LinkOptions

MESSAGE_TYPE: Final = "sensor_msgs/msg/CompressedImage"
COMMAND: Final = "/bench/command"
NODE: Final = "replica"
ACTION: Final = {"name": "/bench/count", "type": "test_msgs/action/Fibonacci", "onSwitch": "Continue"}
LARGEST: Final = "16Mi"
SERVICE: Final = {"name": "/bench/ask", "type": "std_srvs/srv/Trigger", "mode": "Idempotent"}


@dataclass(frozen=True)
class Sensor:
    """A topic of the robot that the cloud needs.

    Attributes:
        name: a word; the topic is /bench/NAME.
        payload_bytes: sizes that take turns.
        max_age_ms: the greatest age that suffices there; 0: the cloud may act without it.
        topic_settings: further settings of the topic.
    """

    name: str
    payload_bytes: tuple[int, ...] = (64,)
    max_age_ms: int = 500
    topic_settings: tuple[tuple[str, Any], ...] = ()

    @property
    def topic(self) -> str:
        """Its name in ROS."""
        return f"/bench/{self.name}"


@dataclass(frozen=True)
class BenchCase:
    """One link case: the link, what runs over it, and every setting that is not the product's default.

    Attributes:
        name: a word, for folders and tables.
        link: the emulated link.
        tolerance_ms: `switching.latency.tolerance`, which sets the loop latency up to which the link is good enough.
        robot_rate_hz: rate of the node on the robot.
        cloud_rate_hz: rate of the node in the cloud.
        command_bytes: payloads of the output, which take turns.
        sensors: what the cloud needs.
        sensor_rate_hz: their rate.
        switching: further settings of `spec.switching`.
        output: further settings of the output.
        standby: standby of the robot's replica.
        cloud_standby: standby of the cloud's.
        serves: whether the replica has an action and a service.
        mirrors: whether its goals go to the standby too.
        state_bytes: size of the replica's snapshots; 0: it has none.
        state_rate_hz: rate of its snapshots.
    """

    name: str
    link: LinkOptions
    tolerance_ms: int = 30
    robot_rate_hz: float = 20.0
    cloud_rate_hz: float = 50.0
    command_bytes: tuple[int, ...] = (64,)
    sensors: tuple[Sensor, ...] = (Sensor("odom"),)
    sensor_rate_hz: float = 20.0
    switching: tuple[tuple[str, Any], ...] = ()
    output: tuple[tuple[str, Any], ...] = ()
    standby: str = "Warm"
    cloud_standby: str = "Warm"
    serves: bool = False
    mirrors: bool = False
    state_bytes: int = 0
    state_rate_hz: float = 10.0

    @property
    def robot_period_ms(self) -> float:
        """The period of the robot's replica; the slower one in every case."""
        return 1000.0 / self.robot_rate_hz

    def describe(self) -> str:
        """Return the link in words, for tables."""
        link = self.link
        words = [f"{link.delay} ± {link.jitter} each way" if link.jitter != "0ms" else f"{link.delay} each way"]
        if link.loss != "0%":
            words.append(f"{link.loss} loss")
        return ", ".join(words)


def offload(case: BenchCase) -> RobotOffload:
    """Return the resource of a case."""
    return parse_object(_document(case), f"case {case.name}")


def _document(case: BenchCase) -> dict[str, Any]:
    sensors: dict[tuple[int, ...], list[Sensor]] = {}
    for sensor in case.sensors:
        sensors.setdefault(sensor.payload_bytes, []).append(sensor)
    return {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": "bench"},
        "spec": {
            "topics": {"toCloud": [_topic(sensor) for sensor in case.sensors]},
            "nodes": [_replica(case), *(_feed(case, number, group) for number, group in enumerate(sensors.values()))],
            "switching": {
                "latency": {
                    "robotPeriod": f"{case.robot_period_ms:.0f}ms",
                    "cloudPeriod": f"{1000.0 / case.cloud_rate_hz:.0f}ms",
                    "tolerance": f"{case.tolerance_ms}ms",
                },
                **({"maxMessageSize": LARGEST} if case.state_bytes else {}),
                **dict(case.switching),
            },
        },
    }


def _topic(sensor: Sensor) -> dict[str, Any]:
    topic = {"name": sensor.topic, **dict(sensor.topic_settings)}
    return {**topic, "maxAge": f"{sensor.max_age_ms}ms"} if sensor.max_age_ms else topic


def _replica(case: BenchCase) -> dict[str, Any]:
    more: dict[str, Any] = {}
    kept: dict[str, Any] = {}
    module = "replica"
    if case.serves:
        module = "goal_server"
        more = {"actions": [{**ACTION, "mirror": case.mirrors}], "services": [SERVICE]}
    if case.state_bytes:
        module = "keeper"
        more = {"state": [{"snapshot": True, "maxAge": "10s", "maxSize": LARGEST}]}
        kept = {"state_bytes": case.state_bytes, "state_hz": case.state_rate_hz}
    return {
        **more,
        "name": NODE,
        "placement": "Duplicated",
        "core": True,
        "standby": {"robot": case.standby, "cloud": case.cloud_standby},
        "run": {
            "command": ["python3", "-m", f"robot_offload_lab.bench.parts.{module}"],
            "parameters": {"rate_hz": case.robot_rate_hz, "payload_bytes": list(case.command_bytes), **kept},
            "cloudParameters": {"rate_hz": case.cloud_rate_hz},
        },
        "outputs": [{"topic": COMMAND, "type": MESSAGE_TYPE, "rate": case.robot_rate_hz, **dict(case.output)}],
    }


def _feed(case: BenchCase, number: int, sensors: list[Sensor]) -> dict[str, Any]:
    """Return one process for all sensors of the same sizes."""
    name = f"feed_{number}"
    return {
        "name": name,
        "placement": "Robot",
        "lifecycle": False,
        "run": {
            "command": ["python3", "-m", "robot_offload_lab.bench.parts.feed", name],
            "parameters": {
                "topics": [sensor.topic for sensor in sensors],
                "rate_hz": case.sensor_rate_hz,
                "payload_bytes": list(sensors[0].payload_bytes),
            },
        },
    }
