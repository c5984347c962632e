"""Which topics cross between the two sides where they talk in topics: exactly the declared ones and the agents' own.

The agents' topics are those of their link over DDS. Nothing of the cloud's nodes crosses by itself: what they publish
travels in the agents' envelopes. Raw topics cross towards the cloud only.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffloadSpec
from robot_offload.api.v1alpha1.names import identifier

_WORDS: Final = {"robot": "local", "cloud": "remote"}


def topics(spec: RobotOffloadSpec) -> tuple[str, ...]:
    """The names in ROS of all topics that cross, each once."""
    return tuple(dict.fromkeys(_topics(spec)))


def _topics(spec: RobotOffloadSpec) -> Iterator[str]:
    for side, word in _WORDS.items():
        yield f"/connectivity_test_{word}"
        yield f"/offload/link/{side}/probe"
        for _, output in spec.collected_outputs:
            yield f"/offload/link/{side}/out_{identifier(output.topic)}"
    for topic in spec.topics.to_cloud:
        yield topic.name
    for _, output in spec.collected_outputs:
        if output.mirror:
            yield output.topic
