"""Debian packages: the user's and those needed by other features, in one command per stage."""

from __future__ import annotations

from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import BuildSpec


class Apt(Feature[BuildSpec]):
    """Debian packages. All stages share its text, which `dockerfiles` fills with the packages of every feature."""

    name = "apt"
    flags = (
        Flag(
            "--apt-package",
            "aptPackages",
            "Debian package that rosdep misses, for build and run; may be repeated.",
            "texts",
            "NAME",
        ),
    )

    def packages(self, spec: BuildSpec, stage: Stage) -> tuple[str, ...]:
        """Return the user's packages, where the source is built and where it runs."""
        return spec.apt_packages if stage in ("dependencies", "runtime") else ()
