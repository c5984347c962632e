"""Transport: how the two sides reach each other. A union: `type` says which block counts."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.quantities import Port


class ZenohTransport(Model):
    """The agents' own sessions: two, both opened by the robot, both mutually authenticated."""

    pulse_port: Port = Field(
        default=7447,
        description="Port on which the cloud agent hears heartbeats and grants (UDP; TCP for the fallback). "
        "Default 7447, from 1 to 65535.",
    )
    data_port: Port = Field(
        default=7448,
        description="Port on which the cloud agent exchanges topics (UDP; TCP for the fallback). Default "
        "7448, from 1 to 65535.",
    )
    fallback: bool = Field(
        default=True,
        description="Whether TLS over TCP is used where UDP does not pass. It is slower to notice losses. "
        "Default true.",
    )


class Transport(Model):
    """How robot and cloud are connected."""

    type: Literal["Zenoh", "ROS"] = Field(
        default="Zenoh",
        description="Zenoh: the agents' own sessions, through NAT and firewalls. ROS: topics over a DDS "
        "network that already joins both sides (a flat network or a VPN). Default Zenoh.",
    )
    zenoh: ZenohTransport = Field(
        default_factory=ZenohTransport, description="Settings of type Zenoh; left out with any other type."
    )
