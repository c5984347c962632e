"""Labels: the image's origin, for people and for registries."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.api.v1alpha1.build_values import commit
from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag
from robot_offload.images.spec import BuildSpec, OverlaySpec

OWN_PREFIX: Final = "dev.robotoffload."
LABEL_FLAG: Final = Flag("--label", "labels", "Further label of the image; may be repeated.", "texts", "NAME=VALUE")


def _check(labels: Mapping[str, str]) -> Iterator[Finding]:
    for name in labels:
        if name.startswith(OWN_PREFIX):
            yield Finding(f"labels.{name}", "Reserved", f"labels that start with {OWN_PREFIX} are set by the image")


class Labels(Feature[BuildSpec]):
    """OCI's labels and our own. No date: the same source gives the same image."""

    name = "labels"
    stages = ("runtime",)
    flags = (LABEL_FLAG,)

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Refuse names with our own prefix."""
        yield from _check(spec.labels)

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return all labels in order; the user's win over those of OCI."""
        labels = {
            "org.opencontainers.image.title": spec.package,
            "org.opencontainers.image.base.name": spec.runtime_image,
        }
        if spec.git:
            labels["org.opencontainers.image.source"] = spec.git.url
            labels["org.opencontainers.image.revision"] = commit(spec.git.ref) or spec.git.ref
        labels |= {
            f"{OWN_PREFIX}distro": spec.distro,
            f"{OWN_PREFIX}package": spec.package,
            f"{OWN_PREFIX}rmw": spec.rmw,
        }
        return {"labels": labels | spec.labels}


class OverlayLabels(Feature[OverlaySpec]):
    """The labels of an image with the agent."""

    name = "labels"
    stages = ("runtime",)
    flags = (LABEL_FLAG,)

    def check(self, spec: OverlaySpec) -> Iterator[Finding]:
        """Refuse names with our own prefix."""
        yield from _check(spec.labels)

    def values(self, spec: OverlaySpec) -> Mapping[str, Any]:
        """Return all labels in order."""
        labels = {
            "org.opencontainers.image.title": "robot-offload-agent",
            "org.opencontainers.image.base.name": spec.onto or spec.agent_image,
            f"{OWN_PREFIX}distro": spec.distro,
            f"{OWN_PREFIX}agent": spec.agent_image,
        }
        return {"labels": labels | spec.labels}
