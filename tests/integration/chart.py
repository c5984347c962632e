"""The chart as the tests use it: values as a mapping, the rendering as objects."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from robot_offload_lab.cluster.commands import Helm

ROOT = Path(__file__).parents[2]
CHART = ROOT / "charts" / "robot-offload"
RELEASE = "robot-offload"
OPERATOR = "robot-offload-operator"

Values = Mapping[str, Any]


def rendered(helm: Helm, values: Values = {}, *arguments: str) -> list[dict[str, Any]]:  # noqa: B006 - never changed
    """What `helm template` makes of these values."""
    text = helm("template", RELEASE, str(CHART), *with_values(values), *arguments)
    return [each for each in yaml.safe_load_all(text) if each]


def with_values(values: Values) -> tuple[str, ...]:
    """Arguments that hand values of any type to helm."""
    return tuple(part for key, value in values.items() for part in ("--set-json", f"{key}={json.dumps(value)}"))


def of_kind(objects: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    """The objects of one kind."""
    return [each for each in objects if each["kind"] == kind]
