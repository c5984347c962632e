"""The custom resource definitions of this repository."""

from __future__ import annotations

from pathlib import Path

DIRECTORY = Path(__file__).parents[3] / "manifests" / "crd"


def definitions() -> list[Path]:
    """Return their files, in a fixed order."""
    return sorted(DIRECTORY.glob("*.yaml"))
