"""OCI archives of one program without a base image: the format that `ctr image import` reads, written by hand."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import tarfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_IMAGE = "application/vnd.oci.image"
NOBODY = "65532:65532"


def write(
    archive: Path,
    name: str,
    program: Path,
    arguments: Sequence[str] = (),
    *,
    folder: str = "",
    user: str = NOBODY,
    more: Mapping[str, Path] = {},  # never changed
) -> None:
    """Write an image that holds a static program and starts it.

    Args:
        archive: The tar file to write; it appears whole or not at all.
        name: Name of the image, with its tag.
        program: Put into the image under its own name.
        arguments: Arguments of the program, unless a pod states others.
        folder: Folder of the program, such as `usr/bin`; the root of the image when left out.
        user: User that runs it, unless a pod states another.
        more: Other files: path in the image, without a leading slash, and source path.
    """
    place = f"{folder}/{program.name}".lstrip("/")
    layer = _layer({place: program, **more})
    packed = gzip.compress(layer, 1, mtime=0)
    config = {
        "architecture": "amd64",
        "os": "linux",
        "config": {"Entrypoint": [f"/{place}"], "Cmd": list(arguments), "User": user},
        "rootfs": {"type": "layers", "diff_ids": [_digest(layer)]},
    }
    manifest = {
        "schemaVersion": 2,
        "mediaType": f"{_IMAGE}.manifest.v1+json",
        "config": {"mediaType": f"{_IMAGE}.config.v1+json", **_described(_json(config))},
        "layers": [{"mediaType": f"{_IMAGE}.layer.v1.tar+gzip", **_described(packed)}],
    }
    notes = {"io.containerd.image.name": name, "org.opencontainers.image.ref.name": name.rsplit(":", 1)[1]}
    entry = {"mediaType": f"{_IMAGE}.manifest.v1+json", **_described(_json(manifest)), "annotations": notes}
    files = {"oci-layout": _json({"imageLayoutVersion": "1.0.0"})}
    files["index.json"] = _json({"schemaVersion": 2, "manifests": [entry]})
    for blob in (packed, _json(config), _json(manifest)):
        files[f"blobs/sha256/{hashlib.sha256(blob).hexdigest()}"] = blob
    scratch = archive.with_suffix(".partial")
    with tarfile.open(scratch, "w") as tar:
        for path, content in files.items():
            tar.addfile(_entry(path, len(content), 0o644), io.BytesIO(content))
    scratch.replace(archive)


def names(archive: Path) -> list[str]:
    """Return the names of the images in an archive."""
    with tarfile.open(archive) as tar:
        index = tar.extractfile("index.json")
        assert index is not None
        notes = [each.get("annotations", {}) for each in json.load(index)["manifests"]]
    found = (each.get("io.containerd.image.name") or each.get("org.opencontainers.image.ref.name") for each in notes)
    return [str(name) for name in found if name]


def _layer(files: Mapping[str, Path]) -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as tar:
        for place, source in files.items():
            content = source.read_bytes()
            tar.addfile(_entry(place, len(content), 0o755), io.BytesIO(content))
    return packed.getvalue()


def _entry(name: str, size: int, mode: int) -> tarfile.TarInfo:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = size, mode
    return entry


def _json(content: Any) -> bytes:
    return json.dumps(content, sort_keys=True).encode()


def _digest(blob: bytes) -> str:
    return f"sha256:{hashlib.sha256(blob).hexdigest()}"


def _described(blob: bytes) -> dict[str, Any]:
    return {"digest": _digest(blob), "size": len(blob)}
