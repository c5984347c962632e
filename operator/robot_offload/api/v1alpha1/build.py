"""What the image of a node is built from: what everybody who builds one must say, and what a cluster adds to it.

The command line adds its own in `images.spec`.
"""

from __future__ import annotations

from pydantic import Field

from robot_offload.api.v1alpha1.build_values import (
    MAX_LISTED,
    AptPackage,
    BaseImage,
    CmakeArgument,
    DistroName,
    GitRef,
    GitUrl,
    LaunchFile,
    PipPackage,
    RelativePath,
    Repository,
    RosdepKey,
)
from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.names import ExecutableName, ObjectName, PackageName
from robot_offload.api.v1alpha1.resources import Resources


class GitRepository(Model):
    """Source code in a git repository; only the named folders of one commit are fetched."""

    url: GitUrl = Field(description="The repository, e.g. https://git.example/robot.git. Without a password.")
    ref: GitRef = Field(
        default="HEAD",
        description="A branch, a tag or, best, a commit (40 digits): only a commit gives the same image twice. "
        "Default HEAD, the newest commit of the default branch.",
    )
    paths: tuple[RelativePath, ...] = Field(
        default=(),
        max_length=MAX_LISTED,
        description="The folders that are needed, e.g. [src/controller]. Default: the whole repository.",
    )

    @property
    def over_ssh(self) -> bool:
        """Whether the repository is read through ssh."""
        return not self.url.startswith(("https://", "file://"))


class BuildFields(Model):
    """What is built, whoever builds it."""

    base: BaseImage | None = Field(
        default=None,
        description="The image to build in, with colcon and rosdep; pin it with @sha256:. Default ros:<distro>.",
    )
    runtime_base: BaseImage | None = Field(
        default=None,
        description="The image that the node runs in. Default: base where given, else ros:<distro>-ros-core.",
    )
    package: PackageName = Field(description="The package of the node; it and what it needs of the source is built.")
    executable: ExecutableName | None = Field(
        default=None, description="What the image runs, as `ros2 run PACKAGE EXECUTABLE`."
    )
    launch: LaunchFile | None = Field(
        default=None, description="What the image runs, as `ros2 launch PACKAGE FILE`. Instead of executable."
    )
    packages: tuple[PackageName, ...] = Field(
        default=(),
        max_length=MAX_LISTED,
        description="Further packages of the source to build, e.g. plugins. Default: none.",
    )
    cmake_arguments: tuple[CmakeArgument, ...] = Field(
        default=("-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF"),
        max_length=MAX_LISTED,
        description="Arguments of CMake. Default: a release build without tests.",
    )
    skip_keys: tuple[RosdepKey, ...] = Field(
        default=(),
        max_length=MAX_LISTED,
        description="rosdep keys that are left out, because they are not needed here. Default: none.",
    )
    apt_packages: tuple[AptPackage, ...] = Field(
        default=(),
        max_length=MAX_LISTED,
        description="Debian packages for build and run that rosdep misses. Default: none.",
    )
    pip_packages: tuple[PipPackage, ...] = Field(
        default=(),
        max_length=MAX_LISTED,
        description="Python packages for build and run that rosdep misses. Default: none.",
    )


class SecretReference(Model):
    """A Secret in the same Kubernetes namespace."""

    name: ObjectName = Field(description="The Secret's name, in the same Kubernetes namespace.")


class NodeBuild(BuildFields):
    """How the image of a node is built in the cluster. The middleware and the environment follow from the resource."""

    distro: DistroName | None = Field(
        default=None, description="The ROS 2 distribution of the image. Default: the robot's."
    )
    git: GitRepository = Field(description="Source code in a git repository.")
    git_secret: SecretReference | None = Field(
        default=None,
        description="The Secret that opens a private repository: of type kubernetes.io/basic-auth (user and token, for "
        "https) or kubernetes.io/ssh-auth with an entry known_hosts beside the key. Default: none.",
    )
    resources: Resources = Field(
        default_factory=Resources, description="Computing resources of the build, for each of its containers."
    )


class Registry(Model):
    """Where images that are built in the cluster are pushed to."""

    repository: Repository = Field(
        description="The registry and a folder in it, e.g. registry.example/robots. The image of package controller is "
        "pushed to registry.example/robots/controller."
    )
    push_secret: SecretReference | None = Field(
        default=None,
        description="The Secret of type kubernetes.io/dockerconfigjson with which images are pushed. No build step "
        "sees it. Default: none, for a registry that asks for no password.",
    )
    pull_secret: SecretReference | None = Field(
        default=None,
        description="The Secret of type kubernetes.io/dockerconfigjson with which a build fetches its base images and "
        "looks whether the image is there already. Build steps can read it. Default: none.",
    )
    insecure: bool = Field(
        default=False,
        description="Whether this registry is spoken to without checking its certificate, or without encryption. "
        "For test clusters. Default false.",
    )
