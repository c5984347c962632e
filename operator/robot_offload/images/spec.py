"""What an image is built from: the `build:` block of a node, and the overlay that puts the agent into an image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationError

from robot_offload.api.strict_yaml import freeze
from robot_offload.api.v1alpha1.build import BuildFields, GitRepository
from robot_offload.api.v1alpha1.build_values import (
    Address,
    BaseImage,
    DistroName,
    FullNodeName,
    LabelName,
    RelativePath,
    Text,
    VariableName,
)
from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.names import PackageName, RmwName
from robot_offload.api.v1alpha1.parsing import findings_of
from robot_offload.errors import SpecError
from robot_offload.images.distros import DISTROS, Distro

SomeModel = TypeVar("SomeModel", bound=Model)


class GitSource(GitRepository):
    """Source code in a git repository; only the named folders of one commit are fetched."""

    credentials: Literal["None", "SSH", "Token"] = Field(
        default="None",
        description="How a private repository is read: SSH (the ssh agent of the build and its secret "
        "known_hosts) or Token (the build's secret git-credentials). Neither gets into the image. Default None.",
    )


class WorkspaceSource(Model):
    """Source code in the folder that is given to the build (its context)."""

    paths: tuple[RelativePath, ...] = Field(
        default=("src",), min_length=1, description="The folders that are copied, in the build context. Default [src]."
    )


class ReposSource(Model):
    """Source code named by a `.repos` file, fetched by vcs."""

    file: RelativePath = Field(description="The file in the build context, e.g. robot.repos.")


class RosEnvironment(Model):
    """Defaults of the ROS network in the image; in a cluster the operator sets what counts there."""

    domain_id: int | None = Field(default=None, ge=0, le=232, description="ROS_DOMAIN_ID. Default: not set.")
    discovery_servers: tuple[Address, ...] = Field(
        default=(),
        max_length=4,
        description="Fast DDS discovery servers in the order of their ids, host or host:port. Default: none.",
    )
    discovery_range: Literal["Subnet", "Localhost", "Off"] | None = Field(
        default=None, description="ROS_AUTOMATIC_DISCOVERY_RANGE, from Iron on. Default: not set."
    )
    static_peers: tuple[Address, ...] = Field(
        default=(), max_length=32, description="ROS_STATIC_PEERS, from Iron on; hosts without ports. Default: none."
    )
    fastdds_transports: Literal["UDPv4", "LARGE_DATA", "SHM", "DEFAULT"] | None = Field(
        default=None, description="FASTDDS_BUILTIN_TRANSPORTS. Default: not set."
    )


class Variable(Model):
    """A variable of the environment."""

    name: VariableName = Field(description="Its name, e.g. RCUTILS_COLORIZED_OUTPUT.")
    value: Text = Field(default="", description="Its value, as it is: nothing in it is expanded. Default: empty.")


class BuildSpec(BuildFields):
    """How the image of one ROS 2 node is built from source."""

    distro: DistroName = Field(default="jazzy", description="The ROS 2 distribution. Default jazzy.")
    git: GitSource | None = Field(default=None, description="Source code in a git repository.")
    workspace: WorkspaceSource | None = Field(default=None, description="Source code in the build context.")
    repos: ReposSource | None = Field(default=None, description="Source code named by a .repos file.")
    arguments: tuple[Text, ...] = Field(default=(), description="Arguments of the program. Default: none.")
    rmw: RmwName = Field(default="rmw_fastrtps_cpp", description="The ROS middleware. Default rmw_fastrtps_cpp.")
    environment: RosEnvironment = Field(default_factory=RosEnvironment, description="The ROS network's defaults.")
    env: tuple[Variable, ...] = Field(default=(), description="Further variables; no secrets. Default: none.")
    node: FullNodeName | None = Field(
        default=None, description="The node's full name, e.g. /talker; for autostart and the health check."
    )
    autostart: bool = Field(
        default=False,
        description="Whether the image takes its managed (lifecycle) node to Active by itself. Not for nodes that an "
        "agent switches: these start Unconfigured. Default false.",
    )
    health_check: Literal["None", "Present", "Active"] = Field(
        default="None",
        description="What HEALTHCHECK asks: whether the node answers in ROS (Present), or is Active (a lifecycle "
        "node). For docker and podman; Kubernetes does not look at it. Default None.",
    )
    user_id: int = Field(default=1000, ge=1, le=65534, description="The user that it runs as; not root. Default 1000.")
    labels: dict[LabelName, Text] = Field(default_factory=dict, description="Further labels. Default: none.")

    @property
    def release(self) -> Distro:
        """The distribution's row in the table."""
        return DISTROS[self.distro]

    @property
    def build_image(self) -> str:
        """The image that the source is built in."""
        return self.base or self.release.build_image

    @property
    def runtime_image(self) -> str:
        """The image that the result is put on."""
        return self.runtime_base or self.base or self.release.runtime_image


class OverlaySpec(Model):
    """An image with the agent and somebody's message packages: the agent over an image, or packages over ours."""

    distro: DistroName = Field(default="jazzy", description="The ROS 2 distribution. Default jazzy.")
    agent_image: BaseImage = Field(description="The image of the agent.")
    onto: BaseImage | None = Field(
        default=None, description="The image with the message packages; the agent is laid over it. Default: none."
    )
    setup_files: tuple[RelativePath, ...] = Field(
        default=(),
        description="Setup files in that image that make its packages known, without the first slash, e.g. "
        "ws/install/setup.bash. Default: none.",
    )
    interface_packages: tuple[PackageName, ...] = Field(
        default=(), description="Packages of messages to install with apt, e.g. nav2_msgs. Default: none."
    )
    user_id: Annotated[int, Field(ge=1, le=65534)] = Field(
        default=1000, description="The user that it runs as; not root. Default 1000."
    )
    labels: dict[LabelName, Text] = Field(default_factory=dict, description="Further labels. Default: none.")


def parse(model: type[SomeModel], value: Mapping[str, object], source: str) -> SomeModel:
    """Read a specification of this module from plain values with YAML names.

    Args:
        model: BuildSpec or OverlaySpec.
        value: mappings, lists, texts, numbers.
        source: what to call it in messages.

    Raises:
        SpecError: with every problem found. Rules between fields are those of the features (`dockerfiles.check`).
    """
    try:
        return model.model_validate(freeze(value), by_alias=True, by_name=False)
    except ValidationError as error:
        raise SpecError(source, findings_of(error, model)) from error
