"""Source code named by a `.repos` file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec


class Repos(Feature[BuildSpec]):
    """Fetches the repositories in the file; cached until the file changes, so it should name commits or tags."""

    name = "repos"
    stages = ("sources",)
    flags = (
        Flag("--repos", "repos.file", "A .repos file in the build context that names the source code.", metavar="FILE"),
    )

    def wanted(self, spec: BuildSpec) -> bool:
        """Return whether the source is a `.repos` file."""
        return spec.repos is not None

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the file and its target."""
        return {"copy": (spec.repos.file if spec.repos else "", "/ws/source.repos")}
