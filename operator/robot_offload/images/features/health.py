"""The health check of docker and podman."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec


class Health(Feature[BuildSpec]):
    """Asks the node in ROS: a running process may have stopped answering."""

    name = "health"
    stages = ("runtime",)
    flags = (
        Flag(
            "--health-check",
            "healthCheck",
            "Present (the node answers in ROS) or Active (a lifecycle node is Active). Default None.",
        ),
    )

    def wanted(self, spec: BuildSpec) -> bool:
        """Return whether the image has a health check."""
        return spec.health_check != "None"

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the question for the helper."""
        command = ("/usr/local/bin/robot-offload-node", "python3", "/usr/local/lib/robot-offload-lifecycle.py")
        return {"command": (*command, spec.health_check.lower())}
