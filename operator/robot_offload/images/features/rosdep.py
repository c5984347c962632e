"""Dependencies of the source, as rosdep finds them in its package.xml files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec


class Rosdep(Feature[BuildSpec]):
    """Installs the build's dependencies and records the run's; the cache depends only on package.xml files."""

    name = "rosdep"
    stages = ("sources", "dependencies")
    flags = (
        Flag("--skip-key", "skipKeys", "rosdep key to leave out; may be repeated.", "texts", "KEY"),
        Flag(
            "--also-build",
            "packages",
            "Further package of the source to build, e.g. a plugin; may be repeated.",
            "texts",
            "PACKAGE",
        ),
    )

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the relevant packages, and the distribution's own values."""
        return {
            "packages": (spec.package, *spec.packages),
            "skip_keys": spec.skip_keys,
            "distro": spec.distro,
            "ended": spec.release.ended,
            "externally_managed": spec.release.externally_managed,
        }
