"""Dockerfiles from specifications: pure, and byte for byte the same for the same specification.

The stages of a node's image: `sources` fetches the code, `dependencies` installs the build's dependencies, `builder`
compiles, `runtime` gets the result and its run-time dependencies. Only the last one is the image.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import jinja2

from robot_offload.errors import SpecError
from robot_offload.findings import Finding
from robot_offload.images import quoting
from robot_offload.images.features import NODE_FEATURES, OVERLAY_FEATURES, Feature, Stage
from robot_offload.images.spec import BuildSpec, OverlaySpec

STAGES: Final[tuple[Stage, ...]] = ("sources", "dependencies", "builder", "runtime")
# Builders read directives at the top; the first line is a comment, so that no value can become one.
_HEAD: Final = (
    "# Made by `robot-offload dockerfile`: change the options there, not this text.\n"
    "# Needs a builder with cache and secret mounts: Docker 23 or newer (BuildKit), podman 4 or buildah 1.28."
)


def check(spec: BuildSpec | OverlaySpec) -> tuple[Finding, ...]:
    """Return the findings of all rules between fields, feature by feature."""
    if isinstance(spec, BuildSpec):
        return tuple(finding for feature in NODE_FEATURES for finding in feature.check(spec))
    return tuple(finding for feature in OVERLAY_FEATURES for finding in feature.check(spec))


def dockerfile(spec: BuildSpec | OverlaySpec) -> str:
    """Return the Dockerfile of a node's image, or of an image with the agent.

    Raises:
        SpecError: a rule between fields is broken.
    """
    errors = [finding for finding in check(spec) if finding.severity == "error"]
    if errors:
        raise SpecError("build", errors)
    blocks = _node_blocks(spec) if isinstance(spec, BuildSpec) else _overlay_blocks(spec)
    return "\n\n".join([_HEAD, *blocks]) + "\n"


def _node_blocks(spec: BuildSpec) -> list[str]:
    blocks = []
    for stage in STAGES:
        image = {"builder": "dependencies", "runtime": spec.runtime_image}.get(stage, spec.build_image)
        foreign = stage != "builder" and image not in (spec.release.build_image, spec.release.runtime_image)
        blocks.append(_from(image, stage, foreign))
        blocks += _blocks(NODE_FEATURES, spec, stage, _cache_of(spec.distro, image, foreign))
    return blocks


def _overlay_blocks(spec: OverlaySpec) -> list[str]:
    blocks = [f"FROM {spec.agent_image} AS agent"] if spec.onto else []
    blocks.append(_from(spec.onto or spec.agent_image, "runtime", foreign=True))
    packages = OVERLAY_FEATURES[0].packages(spec, "runtime")
    if packages:
        cache = _cache_of(spec.distro, spec.onto or spec.agent_image, foreign=True)
        # Stage "sources": the form that installs only named packages, without files of an earlier stage.
        blocks.append(_render("apt.j2", {"stage": "sources", "packages": packages, "cache": cache}))
    return blocks + _blocks(OVERLAY_FEATURES, spec, "runtime", cache="")


def _from(image: str, stage: Stage, foreign: bool) -> str:
    """Return the first lines of a stage. A foreign image may run as a user other than root, who cannot install."""
    return f"FROM {image} AS {stage}" + ("\nUSER 0:0" if foreign else "")


def _cache_of(distro: str, image: str, foreign: bool) -> str:
    """Return the name of package caches: images on different Debian and Ubuntu releases must not share one."""
    return f"{distro}-{hashlib.sha256(image.encode()).hexdigest()[:8]}" if foreign else distro


def _blocks(features: Sequence[Feature[Any]], spec: BuildSpec | OverlaySpec, stage: Stage, cache: str) -> list[str]:
    """Return the text of all features in one stage."""
    blocks = []
    for feature in features:
        if feature.name == "apt":
            packages = [package for one in features for package in one.packages(spec, stage)]
            if packages:
                values = {"stage": stage, "packages": list(dict.fromkeys(packages)), "cache": cache}
                blocks.append(_render("apt.j2", values))
        elif stage in feature.stages and feature.wanted(spec):
            blocks.append(_render(f"{feature.name}.{stage}.j2", {**feature.values(spec), "cache": cache}))
    return blocks


def _render(template: str, values: Mapping[str, Any]) -> str:
    return _ENVIRONMENT.get_template(template).render(values).strip("\n")


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robot_offload.images"),
        autoescape=False,  # noqa: S701 - no HTML; every value goes through a filter of `quoting`
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(quoting.FILTERS)
    return environment


_ENVIRONMENT: Final = _environment()
