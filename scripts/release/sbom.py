"""The bill of materials of a release, in CycloneDX's format: our wheels and images, and every pinned library."""

from __future__ import annotations

import hashlib
import re
import uuid
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import Final

from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom, BomMetaData
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import DisjunctiveLicense
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL

from scripts.release.pins import Pin, normalised

OURS: Final = ("robot-offload-core", "robot-offload-agent", "robot-offload", "robot-offload-lab", "robot-offload-state")
_NAMESPACE: Final = uuid.UUID("6f1b6f0e-4e55-5c53-9d0c-4b1a5c9b2a11")
_REQUIREMENT: Final = re.compile(r"^\s*([A-Za-z0-9][A-Za-z0-9._-]*)")


def sbom(
    version: str, wheels: Iterable[Path], images: Mapping[str, str], pins: Mapping[str, Pin], made: datetime
) -> str:
    """Return the document as JSON. The same release gives the same bytes.

    Args:
        version: of the release.
        wheels: our own.
        images: references by name.
        pins: the tested libraries.
        made: when the release's commit was made.
    """
    product = Component(
        name="robot-offload", version=version, type=ComponentType.APPLICATION, bom_ref=f"robot-offload@{version}"
    )
    bom = Bom(
        serial_number=uuid.uuid5(_NAMESPACE, f"{version} {made.isoformat()}"),
        metadata=BomMetaData(component=product, timestamp=made.astimezone(UTC)),
    )
    ours = {normalised(wheel.name.partition("-")[0]): _wheel(wheel, version) for wheel in wheels}
    others = {name: _library(pin) for name, pin in pins.items()}
    containers = [_image(name, reference, version) for name, reference in sorted(images.items())]
    known = others | ours
    for component in (*known.values(), *containers):
        bom.components.add(component)
    bom.register_dependency(product, [*ours.values(), *containers])
    for name, component in known.items():
        bom.register_dependency(component, [known[other] for other in needed(name) if other in known])
    return JsonV1Dot6(bom).output_as_string(indent=2) + "\n"


def needed(name: str) -> list[str]:
    """Return what a library asks for by its own metadata, extras left out; empty: it is not installed here."""
    try:
        asked = requires(name) or []
    except PackageNotFoundError:
        return []  # one for another platform
    found = (_REQUIREMENT.match(line) for line in asked if "extra ==" not in line)
    return sorted({normalised(match[1]) for match in found if match})


def _wheel(wheel: Path, version: str) -> Component:
    name = normalised(wheel.name.partition("-")[0])
    return Component(
        name=name,
        version=version,
        type=ComponentType.LIBRARY,
        bom_ref=f"{name}@{version}#wheel",
        licenses=[DisjunctiveLicense(id="Apache-2.0")],
        hashes=[_hash(hashlib.sha256(wheel.read_bytes()).hexdigest())],
    )


def _library(pin: Pin) -> Component:
    return Component(
        name=pin.name,
        version=pin.version,
        type=ComponentType.LIBRARY,
        bom_ref=f"{pin.name}@{pin.version}",
        hashes=[_hash(content) for content in pin.hashes],
        purl=PackageURL("pypi", None, pin.name, pin.version),
    )


def _image(name: str, reference: str, version: str) -> Component:
    place, _, digest = reference.partition("@sha256:")
    tagged, colon, tag = place.rpartition(":")
    by_tag = bool(colon) and "/" not in tag
    return Component(
        name=tagged if by_tag else place,
        version=f"sha256:{digest}" if digest else tag if by_tag else version,
        type=ComponentType.CONTAINER,
        bom_ref=f"image:{name}",
        hashes=[_hash(digest)] if digest else [],
    )


def _hash(content: str) -> HashType:
    return HashType(alg=HashAlgorithm.SHA_256, content=content)
