"""Managed (lifecycle) nodes: what activates them, and the helper in the image that does it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import resources
from typing import Any

from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec


class Lifecycle(Feature[BuildSpec]):
    """The agent activates nodes. An image that runs without an agent can do it by itself."""

    name = "lifecycle"
    stages = ("runtime",)
    flags = (
        Flag(
            "--node",
            "node",
            "Full name of the node, e.g. /talker; for --autostart and --health-check. With FILE: which node of the "
            "RobotOffload, e.g. controller.",
        ),
        Flag(
            "--autostart",
            "autostart",
            "Take the lifecycle node to Active when the image starts. Not for nodes that an agent switches.",
            "switch",
        ),
    )

    def wanted(self, spec: BuildSpec) -> bool:
        """Return whether the helper is needed."""
        return spec.autostart or spec.health_check != "None"

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Check that the helper knows its node."""
        if self.wanted(spec) and spec.node is None:
            yield Finding("node", "Required", "is missing; autostart and the health check ask a node by its name")

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the helper's text."""
        helper = resources.files("robot_offload.images.inside").joinpath("lifecycle.py").read_text(encoding="utf-8")
        return {"helper": helper}
