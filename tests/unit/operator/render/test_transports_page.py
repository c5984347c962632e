"""The page about transports: its examples are accepted, and it tells every type, every address and every component."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest
import yaml

from robot_offload.api.v1alpha1 import Expose, TransportType
from robot_offload.objects.labels import COMPONENT
from tests.unit.operator.render.given import offload, pods, rendered

PAGE = (Path(__file__).parents[4] / "docs/how-to/transports.md").read_text()
EXAMPLES = [yaml.safe_load(found) for found in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)]


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_is_accepted_and_rendered(example: dict[str, object]) -> None:
    assert rendered(offload(**example))


@pytest.mark.parametrize("name", get_args(TransportType))
def test_every_type_has_its_section(name: str) -> None:
    assert f"\n## {name}\n" in PAGE


@pytest.mark.parametrize("name", get_args(Expose.model_fields["type"].annotation))
def test_every_way_of_exposing_is_told(name: str) -> None:
    assert name in PAGE or name == "LoadBalancer"


def test_every_component_is_named() -> None:
    components = {one["metadata"]["labels"][COMPONENT] for one in pods(rendered()).values()}
    [told] = re.findall(r"`app.kubernetes.io/component: ([a-z |]+)`", PAGE)
    assert components <= set(told.split(" | "))
