"""The build of the package and of its dependencies from the same source."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec


class Colcon(Feature[BuildSpec]):
    """Builds into /opt/overlay; object files stay in a cache of the builder, so a second build compiles little."""

    name = "colcon"
    stages = ("builder", "runtime")
    flags = (
        Flag("--package", "package", "Package of the node; it and what it needs of the source is built."),
        Flag(
            "--cmake-argument",
            "cmakeArguments",
            "Argument of CMake (-DNAME=value); may be repeated. Default: a release build without tests.",
            "texts",
        ),
    )

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the packages to build, and their cache."""
        return {
            "package": spec.package,
            "packages": (spec.package, *spec.packages),
            "cmake_arguments": spec.cmake_arguments,
            "distro": spec.distro,
            "build_cache": f"{spec.distro}-{_source_key(spec)}",
            "executable": spec.executable,
            "launch": spec.launch,
        }


def _source_key(spec: BuildSpec) -> str:
    """Return a hash per source, so that equal package names of two projects never share object files."""
    source = spec.git.url if spec.git else str(spec.workspace or spec.repos)
    text = "\n".join((source, spec.build_image, *spec.cmake_arguments))
    return hashlib.sha256(text.encode()).hexdigest()[:12]
