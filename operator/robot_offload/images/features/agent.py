"""The agent together with a user's message packages, which it must import to pass on their messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.findings import Finding
from robot_offload.images.features.base import DISTRO_FLAG
from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import OverlaySpec

HOME: Final = "/opt/robot_offload"
"""Where the agent's image keeps its own files: the overlay copies this folder."""


class Agent(Feature[OverlaySpec]):
    """Lays the agent over an image with the messages, or installs message packages over the agent's image."""

    name = "agent"
    stages = ("runtime",)
    flags = (
        DISTRO_FLAG,
        Flag("--from", "onto", "With --agent: image to lay the agent over.", metavar="IMAGE"),
        Flag(
            "--setup",
            "setupFiles",
            "With --agent: setup file in that image, without the first slash; may be repeated.",
            "texts",
            "FILE",
        ),
        Flag(
            "--interfaces",
            "interfacePackages",
            "With --agent: package of messages to install with apt; may be repeated.",
            "texts",
            "PACKAGE",
        ),
        Flag(
            "--agent-image",
            "agentImage",
            "With --agent: image of the agent. Default: the released one.",
            metavar="IMAGE",
        ),
    )

    def check(self, spec: OverlaySpec) -> Iterator[Finding]:
        """Refuse a layer that adds nothing."""
        if spec.onto is None and not spec.interface_packages:
            yield Finding("onto", "Required", "name the image with the messages (--from) or packages (--interfaces)")

    def packages(self, spec: OverlaySpec, stage: Stage) -> tuple[str, ...]:
        """Return message packages by their Debian names."""
        return tuple(f"ros-{spec.distro}-{name.replace('_', '-')}" for name in spec.interface_packages)

    def values(self, spec: OverlaySpec) -> Mapping[str, Any]:
        """Return the layers."""
        return {
            "home": HOME,
            "distro": spec.distro,
            "onto": spec.onto,
            "setup": ":".join(f"/{path}" for path in spec.setup_files),
        }
