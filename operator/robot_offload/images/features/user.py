"""The image's user."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec, OverlaySpec


class User(Feature[BuildSpec | OverlaySpec]):
    """Not root, as a number: Kubernetes cannot check a name. Everything is written to /tmp."""

    name = "user"
    stages = ("runtime",)
    flags = (Flag("--user-id", "userID", "User that the image runs as; not root. Default 1000.", "number", "NUMBER"),)

    def values(self, spec: BuildSpec | OverlaySpec) -> Mapping[str, Any]:
        """Return the number."""
        return {"user_id": spec.user_id}
