"""Debian packages: those the user names and those the other features need, in one command per stage."""

from __future__ import annotations

from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import BuildSpec


class Apt(Feature[BuildSpec]):
    """Its text is shared by all stages, so `dockerfiles` fills it with the packages of every feature."""

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
        """Return what the user names, where the source is built and where it runs."""
        return spec.apt_packages if stage in ("dependencies", "runtime") else ()
