"""What the inputs ask of the link, as far as their types tell: a raw image is the usual reason for a bad one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.findings import Finding

USUAL_RATE_HZ: Final = 30.0
"""Of a camera, where no maxRate is set."""
MUCH_MBIT_S: Final = 10.0
_SIZES: Final = {
    "sensor_msgs/msg/Image": (640 * 480 * 3, "of 640 x 480 pixels in colour"),
    "sensor_msgs/msg/PointCloud2": (16 * 1800 * 16, "of 16 lines with 1,800 points of 16 bytes"),
}
"""Bytes of one message of a small sensor; these types carry no compressed data."""


def large_topics_fit_the_link(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Warn of raw images and point clouds, with an estimate for a small sensor."""
    for i, topic in enumerate(spec.topics.to_cloud):
        if topic.type not in _SIZES:
            continue
        size, what = _SIZES[topic.type]
        rate_hz = topic.max_rate_hz or USUAL_RATE_HZ
        mbit_s = size * 8 * rate_hz / 1e6
        if mbit_s < MUCH_MBIT_S:
            continue
        yield Finding(
            f"spec.topics.toCloud[{i}]",
            "MuchForALink",
            f"{topic.name!r} carries raw data: messages {what} at {rate_hz:g} Hz are {mbit_s:.0f} Mbit/s; declare the "
            "compressed topic of its image or point cloud transport, or set maxRate",
            "warning",
        )
