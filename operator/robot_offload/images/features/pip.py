"""Python packages, in a separate folder that both the build and the run see."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import BuildSpec


class Pip(Feature[BuildSpec]):
    """Installs into /opt/python, so that the final image needs no pip and the system's Python is unchanged."""

    name = "pip"
    stages = ("dependencies",)
    flags = (
        Flag(
            "--pip-package",
            "pipPackages",
            "Python package that rosdep misses, for build and run; may be repeated.",
            "texts",
            "NAME",
        ),
    )

    def packages(self, spec: BuildSpec, stage: Stage) -> tuple[str, ...]:
        """Return pip, which the official images do not have."""
        return ("python3-pip",) if spec.pip_packages and stage == "dependencies" else ()

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the user's packages; rosdep adds its own in the build."""
        return {"pip_packages": spec.pip_packages}
