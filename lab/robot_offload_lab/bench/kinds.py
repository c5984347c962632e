"""The field's standard experiment: ten publishers and ten subscribers, one for each type of message with a header.

Pure: names and types; `parts.kinds_source` fills the messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from robot_offload.api.v1alpha1 import RobotOffload

RATE_HZ: Final = 10.0


@dataclass(frozen=True)
class MessageKind:
    """One type of message.

    Attributes:
        name: a word, used in topic names.
        type: as ROS names it.
    """

    name: str
    type: str

    @property
    def sent(self) -> str:
        """The topic on which it is published on the robot."""
        return f"/bench/in/{self.name}"

    @property
    def returned(self) -> str:
        """The topic on which the far end sends it back."""
        return f"/bench/out/{self.name}"


KINDS: Final = (
    MessageKind("imu", "sensor_msgs/msg/Imu"),
    MessageKind("scan", "sensor_msgs/msg/LaserScan"),
    MessageKind("range", "sensor_msgs/msg/Range"),
    MessageKind("fix", "sensor_msgs/msg/NavSatFix"),
    MessageKind("joints", "sensor_msgs/msg/JointState"),
    MessageKind("battery", "sensor_msgs/msg/BatteryState"),
    MessageKind("magnet", "sensor_msgs/msg/MagneticField"),
    MessageKind("pose", "geometry_msgs/msg/PoseStamped"),
    MessageKind("twist", "geometry_msgs/msg/TwistStamped"),
    MessageKind("transform", "geometry_msgs/msg/TransformStamped"),
)


def offload(transport: str, link_ms: float) -> RobotOffload:
    """Return a RobotOffload whose node in the cloud sends every message back, by link and collector.

    Args:
        transport: `spec.transport.type`.
        link_ms: the link's round trip, which the tolerance has to allow for.
    """
    from robot_offload.api.v1alpha1.parsing import parse_object  # noqa: PLC0415 - the echo in a pod has no pydantic

    block = {"staticPeers": {"robot": ["127.0.0.1"]}} if transport == "StaticPeers" else {}
    document: dict[str, Any] = {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": "bench"},
        "spec": {
            "transport": {"type": transport, **block},
            "topics": {"toCloud": [{"name": kind.sent, "type": kind.type} for kind in KINDS]},
            "nodes": [
                {
                    "name": "echo",
                    "placement": "Duplicated",
                    "run": {"command": ["python3", "-m", "robot_offload_lab.bench.parts.echo"]},
                    "outputs": [{"topic": kind.returned, "type": kind.type, "rate": RATE_HZ} for kind in KINDS],
                },
                {
                    "name": "kinds",
                    "placement": "Robot",
                    "lifecycle": False,
                    "run": {"command": ["python3", "-m", "robot_offload_lab.bench.parts.kinds_source"]},
                },
            ],
            "switching": {
                "latency": {"robotPeriod": "100ms", "cloudPeriod": "100ms", "tolerance": f"{link_ms + 30:.0f}ms"}
            },
        },
    }
    return parse_object(document, "the experiment with ten types")
