"""The golden cases: a specification beside the Dockerfile that it must give, byte for byte."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import yaml

from robot_offload.images.dockerfiles import dockerfile
from robot_offload.images.spec import BuildSpec, OverlaySpec, parse

HERE: Final = Path(__file__).parent
CASES: Final = tuple(sorted(path.parent.name for path in HERE.glob("*/spec.yaml")))


def spec_of(case: str) -> BuildSpec | OverlaySpec:
    """The specification of a case."""
    value = yaml.safe_load((HERE / case / "spec.yaml").read_text(encoding="utf-8"))
    if "build" in value:
        return parse(BuildSpec, value["build"], case)
    return parse(OverlaySpec, value["overlay"], case)


def generated(case: str) -> str:
    """The Dockerfile that we make now."""
    return dockerfile(spec_of(case))


def golden_path(case: str) -> Path:
    """The Dockerfile that was looked at and committed."""
    return HERE / case / "Dockerfile"
