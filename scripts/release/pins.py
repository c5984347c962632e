"""What requirements/all.txt pins: names, versions and hashes of the tested libraries."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

_PIN: Final = re.compile(r"^(?P<name>[A-Za-z0-9_.-]+)(?:\[[^\]]*\])?==(?P<version>[^\s;\\]+)")
_HASH: Final = re.compile(r"--hash=sha256:([0-9a-f]{64})")


@dataclass(frozen=True, slots=True)
class Pin:
    """One pinned library.

    Attributes:
        name: normalised: lower case, with dashes.
        version: that was tested.
        hashes: SHA-256 of each of its files that may be installed.
    """

    name: str
    version: str
    hashes: Sequence[str]


def normalised(name: str) -> str:
    """Return a library's name as indexes compare names."""
    return re.sub(r"[-_.]+", "-", name).lower()


def read(requirements: str) -> dict[str, Pin]:
    """Return the pins of a requirements file by name."""
    found: dict[str, Pin] = {}
    for block in re.split(r"\n(?=\S)", requirements):
        pin = _PIN.match(block)
        if pin is not None:
            name = normalised(pin["name"])
            found[name] = Pin(name, pin["version"], tuple(_HASH.findall(block)))
    return found
