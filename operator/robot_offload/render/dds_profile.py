"""A transport's Fast DDS profile: settings without an environment variable, as a file in every pod with ROS."""

from __future__ import annotations

from typing import Final

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects import pod
from robot_offload.objects.names import DDS, child_name
from robot_offload.objects.parent import Parent, Part

DIRECTORY: Final = "/etc/robot-offload/dds"
KEY: Final = "fastdds.xml"
_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Fast DDS 2 knows only the first name, Fast DDS 3 the second one."""


def config_maps(parent: Parent) -> tuple[Manifest, ...]:
    """Return the ConfigMap with the profile; none if the transport has no profile."""
    text = _text(parent.offload)
    return (parent.config_map(Part(_name(parent.offload), "settings"), {KEY: text}),) if text else ()


def volumes(offload: RobotOffload) -> list[Manifest]:
    """Return the volume of a pod with ROS."""
    return [pod.config_map_volume("dds", _name(offload), [KEY])] if _text(offload) else []


def mounts(offload: RobotOffload) -> list[Manifest]:
    """Return the profile's mount in a container with ROS."""
    return [pod.mount("dds", DIRECTORY)] if _text(offload) else []


def environment(offload: RobotOffload) -> dict[str, str]:
    """Return the variables that name the profile for Fast DDS."""
    return dict.fromkeys(_VARIABLES, f"{DIRECTORY}/{KEY}") if _text(offload) else {}


def _text(offload: RobotOffload) -> str:
    return transport.of(offload.spec).traits.dds_profile


def _name(offload: RobotOffload) -> str:
    return child_name(offload.metadata.name, DDS)
