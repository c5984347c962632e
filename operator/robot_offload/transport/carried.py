"""The topics that cross between sides that talk through topics: exactly the declared ones and the agents' own.

Raw topics cross only towards the cloud. Messages of the cloud's nodes travel to the robot in the agents' envelopes, so
towards the robot there are only the topics of the cloud's agent.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffloadSpec
from robot_offload.api.v1alpha1.names import identifier

_BEATS: Final = {"robot": "/connectivity_test_local", "cloud": "/connectivity_test_remote"}
_BEAT_TYPE: Final = "std_msgs/msg/Header"
_FRAME_TYPE: Final = "std_msgs/msg/UInt8MultiArray"


def topics(spec: RobotOffloadSpec) -> tuple[str, ...]:
    """Return the names in ROS of all topics that cross, each once."""
    return tuple(dict.fromkeys((*to_cloud(spec), *to_robot(spec))))


def to_robot(spec: RobotOffloadSpec) -> dict[str, str]:
    """Return the topics that cross towards the robot and their types: those of the cloud's agent, which are known."""
    return dict(_agents(spec, "cloud"))


def to_cloud(spec: RobotOffloadSpec) -> tuple[str, ...]:
    """Return the topics that cross towards the cloud: those of the robot's agent, inputs, mirrored outputs."""
    inputs = [topic.name for topic in spec.topics.to_cloud]
    mirrored = [output.topic for _, output in spec.collected_outputs if output.mirror]
    own = [name for name, _ in _agents(spec, "robot")]
    return tuple(dict.fromkeys((*own, *inputs, *mirrored)))


def _agents(spec: RobotOffloadSpec, side: str) -> Iterator[tuple[str, str]]:
    """Yield the topics that a side's agent sends on its link over DDS."""
    yield _BEATS[side], _BEAT_TYPE
    yield f"/offload/link/{side}/probe", _FRAME_TYPE
    yield f"/offload/link/{side}/report", _FRAME_TYPE
    for _, output in spec.collected_outputs:
        yield f"/offload/link/{side}/out_{identifier(output.topic)}", _FRAME_TYPE
    if any(node.offered or node.called for node in spec.nodes):
        yield f"/offload/link/{side}/relay", _FRAME_TYPE
    for name in (name for node in spec.nodes for name, state in node.named_state if state.snapshot):
        yield f"/offload/link/{side}/state_{name}", _FRAME_TYPE
