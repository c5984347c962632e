"""RobotOffloads for the tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

SAMPLES = Path(__file__).parents[2] / "manifests" / "samples"


def talker() -> dict[str, Any]:
    """The smallest sample, as plain values; each call gives a copy to change."""
    resource = yaml.safe_load((SAMPLES / "talker.yaml").read_text())
    assert isinstance(resource, dict)
    return resource
