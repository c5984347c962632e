"""The distribution and the base images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec

DISTRO_FLAG: Final = Flag(
    "--distro", "distro", "ROS 2 distribution: foxy, humble, jazzy, kilted or rolling. Default jazzy."
)


class Base(Feature[BuildSpec]):
    """The base images. `dockerfiles`, which knows the stages, writes the FROM lines."""

    name = "base"
    flags = (
        DISTRO_FLAG,
        Flag(
            "--base",
            "base",
            "Image to build in, with colcon and rosdep. Pin it with @sha256:... Default ros:DISTRO.",
            metavar="IMAGE",
        ),
        Flag(
            "--runtime-base",
            "runtimeBase",
            "Image that the node runs in. Default: --base where given, else ros:DISTRO-ros-core.",
            metavar="IMAGE",
        ),
    )

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Report what the table warns of about the distribution, and that there is exactly one source."""
        if spec.release.warning:
            yield Finding("distro", "Distro", spec.release.warning, "warning")
        given = [name for name in ("git", "workspace", "repos") if getattr(spec, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            yield Finding("", "Source", f"needs exactly one source, found {found}; give git, workspace or repos")
