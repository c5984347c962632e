"""The differences between the ROS 2 distributions, with the source of each fact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from robot_offload.api.v1alpha1.build_values import DistroName

StopSignal: TypeAlias = Literal["SIGINT", "SIGTERM"]

_RMW: Final = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp", "rmw_connextdds")


@dataclass(frozen=True, slots=True)
class Distro:
    """One distribution of ROS 2.

    Attributes:
        name: as in `ROS_DISTRO`.
        ubuntu: the release of its official image.
        supported_until: year and month; empty: no end is set.
        ended: whether it is end of life.
        rmw: the middlewares in its package repository.
        externally_managed: whether its Python refuses `pip install` into the system (PEP 668).
        static_peers: whether it knows ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS.
        stop_signal: the signal that ends its nodes in an orderly way.
        warning: what its users should know; empty: nothing.
    """

    name: DistroName
    ubuntu: str
    supported_until: str
    rmw: tuple[str, ...]
    ended: bool = False
    externally_managed: bool = True
    static_peers: bool = True
    stop_signal: StopSignal = "SIGTERM"
    warning: str = ""

    @property
    def build_image(self) -> str:
        """The official image with compilers, colcon, rosdep and vcs."""
        return f"docker.io/library/ros:{self.name}"

    @property
    def runtime_image(self) -> str:
        """The official image for running nodes only."""
        return f"docker.io/library/ros:{self.name}-ros-core"


# Sources, looked up for this table:
# - images, Ubuntu releases and contents: docker-library/official-images `library/ros` and osrf/docker_images
#   `ros/<distro>/ubuntu/<codename>/{ros-core,ros-base}/Dockerfile` (ros-base adds build-essential, git, colcon, rosdep
#   and vcstool to ros-core, and runs `rosdep init`);
# - end of life: docs.ros.org "Releases", endoflife.date/ros-2; rosdistro `index-v4.yaml` (distribution_status);
# - rmw_zenoh_cpp: package ros-humble-rmw-zenoh-cpp 0.1.x and newer; never released for foxy;
# - PEP 668: Ubuntu since 23.04, so 22.04 (humble) and 20.04 (foxy) take `pip install`;
# - static peers: "Improved dynamic discovery" in the documentation of ROS 2, since Iron;
# - signals: rclcpp `signal_handler.cpp` and rclpy `signals.py` handle SIGTERM since Galactic; before, SIGINT only;
# - foxy's apt key: osrf/docker_images#697 (its image reads snapshots.ros.org with a key that ended 2023-11-19).
DISTROS: Final[dict[DistroName, Distro]] = {
    distro.name: distro
    for distro in (
        Distro(
            name="foxy",
            ubuntu="20.04",
            supported_until="2023-06",
            rmw=("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp"),
            ended=True,
            externally_managed=False,
            static_peers=False,
            stop_signal="SIGINT",
            warning="foxy is end of life since 2023-06: no more security fixes, and the package key in its official "
            "image may have expired (osrf/docker_images#697); give --base an image whose `apt-get update` works, or "
            "move to jazzy",
        ),
        Distro(
            name="humble",
            ubuntu="22.04",
            supported_until="2027-05",
            rmw=(*_RMW, "rmw_zenoh_cpp"),
            externally_managed=False,
            static_peers=False,
        ),
        Distro(name="jazzy", ubuntu="24.04", supported_until="2029-05", rmw=(*_RMW, "rmw_zenoh_cpp")),
        Distro(name="kilted", ubuntu="24.04", supported_until="2026-12", rmw=(*_RMW, "rmw_zenoh_cpp")),
        Distro(
            name="rolling",
            ubuntu="24.04 or newer",
            supported_until="",
            rmw=(*_RMW, "rmw_zenoh_cpp"),
            warning="rolling changes every week; pin its images by digest (--base ...@sha256:...) to get the same "
            "image twice",
        ),
    )
}
