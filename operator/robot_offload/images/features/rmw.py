"""The ROS middleware."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import BuildSpec

DEFAULT: Final = "rmw_fastrtps_cpp"
"""Part of every official image; the dynamic variant has its own package."""


class Rmw(Feature[BuildSpec]):
    """Installs the middleware; `environment` makes it the default."""

    name = "rmw"
    flags = (Flag("--rmw", "rmw", "ROS middleware, e.g. rmw_cyclonedds_cpp. Default rmw_fastrtps_cpp."),)

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Check that the distribution has the middleware."""
        if spec.rmw not in spec.release.rmw:
            known = ", ".join(spec.release.rmw)
            yield Finding("rmw", "NotSupported", f"{spec.rmw} is not packaged for {spec.distro}; it has {known}")

    def packages(self, spec: BuildSpec, stage: Stage) -> tuple[str, ...]:
        """Return its package, if the official image lacks it."""
        if stage != "runtime" or spec.rmw == DEFAULT:
            return ()
        return (f"ros-{spec.distro}-{spec.rmw.replace('_', '-')}",)
