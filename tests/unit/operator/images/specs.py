"""Specifications for the tests: a small valid one, and the same with something changed."""

from __future__ import annotations

from typing import Any

from robot_offload.images.spec import BuildSpec, parse


def plain(**changes: Any) -> dict[str, Any]:
    """The YAML form of a small specification."""
    return {"workspace": {}, "package": "controller", "executable": "controller_server"} | changes


def build_spec(**changes: Any) -> BuildSpec:
    """A small specification."""
    return parse(BuildSpec, plain(**changes), "test")
