"""The features of images, one class each. The order of these lists is the order of their text in each stage."""

from __future__ import annotations

from typing import Final

from robot_offload.images.features.agent import Agent
from robot_offload.images.features.apt import Apt
from robot_offload.images.features.base import Base
from robot_offload.images.features.colcon import Colcon
from robot_offload.images.features.entrypoint import Entrypoint
from robot_offload.images.features.environment import Environment
from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.features.git import Git
from robot_offload.images.features.health import Health
from robot_offload.images.features.labels import Labels, OverlayLabels
from robot_offload.images.features.lifecycle import Lifecycle
from robot_offload.images.features.pip import Pip
from robot_offload.images.features.repos import Repos
from robot_offload.images.features.rmw import Rmw
from robot_offload.images.features.rosdep import Rosdep
from robot_offload.images.features.user import User
from robot_offload.images.features.workspace import Workspace
from robot_offload.images.spec import BuildSpec, OverlaySpec

__all__ = ["NODE_FEATURES", "OVERLAY_FEATURES", "Feature", "Flag", "Stage"]

# What changes seldom comes first, so that a change invalidates as few cached layers as possible.
NODE_FEATURES: Final[tuple[Feature[BuildSpec], ...]] = (
    Base(),
    Apt(),
    Git(),
    Workspace(),
    Repos(),
    Rosdep(),
    Pip(),
    Lifecycle(),
    Entrypoint(),
    User(),
    Colcon(),
    Rmw(),
    Environment(),
    Labels(),
    Health(),
)
OVERLAY_FEATURES: Final[tuple[Feature[OverlaySpec], ...]] = (Agent(), User(), OverlayLabels())
