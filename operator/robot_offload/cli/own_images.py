"""Default images of our own programs, for when no cluster names them."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version

from robot_offload.kube.port import Manifest
from robot_offload.objects import facts
from robot_offload.objects.facts import Images


def default_images() -> Images:
    """Return the images of this version, as the chart installs them."""
    return facts.default_images(version("robot-offload"))


def images_in_use(deployments: list[Manifest]) -> Images:
    """Return the images of a running RobotOffload; the default where a Deployment is missing."""
    default, found = default_images(), dict(_containers(deployments))
    return Images(
        agent=found.get("agent", default.agent),
        operator=found.get("reporter", default.operator),
        discovery=found.get("discovery", default.discovery),
        router=found.get("router", default.router),
        git=default.git,
    )


def _containers(deployments: list[Manifest]) -> Iterator[tuple[str, str]]:
    for deployment in deployments:
        for container in deployment["spec"]["template"]["spec"]["containers"]:
            yield container["name"], container["image"]
