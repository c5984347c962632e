"""The configuration of the emulated DDS link: which topics cross between the two domains, and which way."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffloadSpec
from robot_offload.api.v1alpha1.names import identifier
from robot_offload_lab.wire.link import Direction
from robot_offload_lab.wire.options import LinkOptions

BEAT_TYPE: Final = "std_msgs/msg/Header"
FRAME_TYPE: Final = "std_msgs/msg/UInt8MultiArray"
_WORDS: Final = {"Reliable": "reliable", "BestEffort": "best_effort"}


@dataclass(frozen=True)
class Carried:
    """One topic in one direction.

    Attributes:
        topic: its name on both sides.
        direction: `up` from robot to cloud.
        type: its message type; empty: from the graph.
        reliability: `reliable` or `best_effort`; empty: as its publisher.
        latched: whether its last messages are kept for late subscribers.
    """

    topic: str
    direction: Direction
    type: str = ""
    reliability: str = ""
    latched: bool = False


@dataclass(frozen=True)
class DdsWireConfig:
    """The configuration of the process.

    Attributes:
        domains: ROS domains of robot and cloud.
        carried: the topics that cross; no others do.
        link: what the link does.
        seed: seed of its random draws.
    """

    domains: tuple[int, int]
    carried: tuple[Carried, ...]
    link: LinkOptions
    seed: int

    def to_json(self) -> str:
        """Return the configuration file."""
        return json.dumps(dataclasses.asdict(self), indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str) -> DdsWireConfig:
        """Read what `to_json` has written."""
        values = json.loads(text)
        carried = tuple(Carried(**one) for one in values["carried"])
        robot, cloud = values["domains"]
        return cls((robot, cloud), carried, LinkOptions.from_dict(values["link"]), values["seed"])


def carried(spec: RobotOffloadSpec) -> tuple[Carried, ...]:
    """Return what a DDS router would be allowed to carry: the agents' topics, inputs, and mirrored outputs.

    The agents' topics have the names of their link over DDS; topics of the cloud's nodes do not cross by themselves.
    """
    return tuple(_carried(spec))


def _carried(spec: RobotOffloadSpec) -> Iterator[Carried]:
    ways: tuple[tuple[Direction, str, str], ...] = (("up", "robot", "local"), ("down", "cloud", "remote"))
    for direction, side, word in ways:
        yield Carried(f"/connectivity_test_{word}", direction, BEAT_TYPE, "best_effort")
        yield Carried(f"/offload/link/{side}/probe", direction, FRAME_TYPE, "best_effort")
        yield Carried(f"/offload/link/{side}/report", direction, FRAME_TYPE, "best_effort")
        for _, output in spec.collected_outputs:
            chosen = _WORDS.get((output.qos.reliability if output.qos else "") or "", "reliable")
            yield Carried(f"/offload/link/{side}/out_{identifier(output.topic)}", direction, FRAME_TYPE, chosen)
        if any(node.offered or node.called for node in spec.nodes):
            yield Carried(f"/offload/link/{side}/relay", direction, FRAME_TYPE, "reliable")
        for name in (name for node in spec.nodes for name, state in node.named_state if state.snapshot):
            yield Carried(f"/offload/link/{side}/state_{name}", direction, FRAME_TYPE, "reliable")
    for topic in spec.topics.to_cloud:
        chosen = _WORDS.get((topic.qos.reliability if topic.qos else "") or "", "")
        yield Carried(topic.name, "up", topic.type or "", chosen, topic.latched)
    for _, output in spec.collected_outputs:
        if output.mirror:
            yield Carried(output.topic, "up", output.type or "")
