"""Source code from the folder given to the build."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec


class Workspace(Feature[BuildSpec]):
    """Copies folders of a local workspace; a `.dockerignore` beside them keeps build/, install/ and log/ out."""

    name = "workspace"
    stages = ("sources",)
    flags = (
        Flag(
            "--workspace",
            "workspace.paths",
            "Folder with source code in the build context, usually src; may be repeated.",
            "texts",
            "FOLDER",
        ),
    )

    def wanted(self, spec: BuildSpec) -> bool:
        """Return whether the source is in the build context."""
        return spec.workspace is not None

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the source and target folders."""
        paths = spec.workspace.paths if spec.workspace else ()
        return {"copies": [("./", "/ws/src/") if path == "." else (f"{path}/", f"/ws/src/{path}/") for path in paths]}
