"""The images of a release: where they are, and by which digests once they are pushed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robot_offload.objects.facts import BUILDER

OURS: Final = ("agent", "discovery", "git", "operator", "router")
EXAMPLES: Final = ("talker", "wheelchair", "sedia", "sedia-agent")
"""Of the samples; the chart names none of them."""
_LINE: Final = re.compile(r"(?P<name>[a-z/-]+) (?P<digest>sha256:[0-9a-f]{64})")


class DigestsError(Exception):
    """The file with digests cannot be read; the message names the line."""


def digests(path: Path | None) -> dict[str, str]:
    """Return digests by the image's name, from what `make images` has written; empty: nothing was pushed yet.

    Raises:
        DigestsError: a line is not `NAME sha256:...`.
    """
    if path is None or not path.exists():
        return {}
    found: dict[str, str] = {}
    for line in filter(None, map(str.strip, path.read_text(encoding="utf-8").splitlines())):
        match = _LINE.fullmatch(line)
        if match is None:
            raise DigestsError(f"{path}: {line[:80]!r}: write NAME sha256:..., as make images does")
        found[match["name"]] = match["digest"]
    return found


def references(registry: str, version: str, known: Mapping[str, str]) -> dict[str, str]:
    """Return the complete reference of each image by name: by digest where that is known, else by tag."""
    ours = {name: f"{registry}/{name}" for name in OURS} | {
        f"examples/{name}": f"{registry}/examples/{name}" for name in EXAMPLES
    }
    found = {name: f"{place}@{known[name]}" if name in known else f"{place}:{version}" for name, place in ours.items()}
    return {**found, "builder": BUILDER}


def values(registry: str, version: str, known: Mapping[str, str]) -> dict[str, str]:
    """Return the chart values (dotted names) that make a cluster run exactly these images."""
    found = {"images.registry": registry}
    if not known:
        return found
    all_ = references(registry, version, known)
    return found | {f"images.{name}": all_[name] for name in OURS if name in known}
