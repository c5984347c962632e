"""The kubectl plugin as an archive for this platform, and the manifest by which krew installs it.

The archive holds a folder of libraries and a program that starts them with the user's own Python 3.12: libraries with
compiled parts fit one version of Python and one platform. A release for several platforms calls this on each of them.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import platform
import re
import tarfile
from collections.abc import Iterable, Sequence
from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import Any, Final

import yaml

from scripts.release.pins import normalised
from scripts.release.sbom import needed

PLUGIN: Final = "kubectl-offload"
EXTRAS: Final = ("kubernetes", "aiohttp")
"""What the commands for a cluster need beside the package's own dependencies (its extra `cluster`)."""
_ARCHITECTURES: Final = {"x86_64": "amd64", "aarch64": "arm64", "arm64": "arm64"}
_ARCHIVE: Final = re.compile(rf"{PLUGIN}-(?P<os>[a-z]+)-(?P<arch>[a-z0-9]+)\.tar\.gz")
_LEFT_OUT: Final = re.compile(r"__pycache__|\.pyc$|^\.\.|/tests?/|direct_url\.json|^__editable__|\.pth$")
_TYPED: Final = re.compile(r"^kubernetes/.*client/(api|models)/(?!__init__\.py$)")
"""The typed half of the Kubernetes client (100 MB, loaded on demand only): ours is the dynamic one."""
PROGRAM: Final = '''\
#!/usr/bin/env python3
"""kubectl offload, with its libraries beside it."""

import os
import shutil
import sys

if sys.version_info[:2] != (3, 12):
    found = shutil.which("python3.12")
    if found is None:
        sys.exit("kubectl offload needs Python 3.12, and there is no python3.12 on PATH. Next: install one")
    os.execv(found, [found, os.path.realpath(__file__), *sys.argv[1:]])
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "lib"))

from robot_offload.cli.main import app

sys.argv[0] = "kubectl-offload"
app()
'''
MANIFEST: Final = {
    "apiVersion": "krew.googlecontainertools.github.com/v1alpha2",
    "kind": "Plugin",
    "metadata": {"name": "offload"},
}
SHORT: Final = "Status, bundles and pins of robots whose ROS 2 nodes run in the cluster"
DESCRIPTION: Final = """\
Works with RobotOffload resources: shows which side acts and why, explains what is not ready and the next step, writes
the folder that a robot needs, pins the application on one side, and revokes a robot's certificates.
"""
CAVEATS: Final = "Needs Python 3.12. The cluster needs the operator of Robot Offload.\n"


def archive(folder: Path, operator: Path, license_file: Path, epoch_s: int) -> Path:
    """Write the archive for this platform into a folder; return its path.

    Args:
        folder: where to.
        operator: the folder of the package with the command line.
        license_file: our license.
        epoch_s: of all files, so that the same commit gives the same bytes.
    """
    system, machine = platform.system().lower(), platform.machine()
    path = folder / f"{PLUGIN}-{system}-{_ARCHITECTURES.get(machine, machine)}.tar.gz"
    entries = [(PLUGIN, PROGRAM.encode(), 0o755), ("LICENSE", license_file.read_bytes(), 0o644)]
    for source in sorted((operator / "robot_offload").rglob("*")):
        if source.is_file() and "__pycache__" not in source.parts:
            entries.append((f"lib/{source.relative_to(operator)}", source.read_bytes(), 0o644))
    for name in libraries():
        entries += [(f"lib/{where}", content, 0o644) for where, content in _files(distribution(name))]
    entries += _own_metadata(distribution("robot-offload"))
    with (
        path.open("wb") as raw,
        gzip.GzipFile(fileobj=raw, mode="wb", filename="", mtime=epoch_s) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as written,
    ):
        for where, content, mode in sorted(entries):
            about = tarfile.TarInfo(where)
            about.size, about.mode, about.mtime = len(content), mode, epoch_s
            written.addfile(about, io.BytesIO(content))
    return path


def libraries() -> Sequence[str]:
    """Return what the plugin needs, with all that follows, as far as this platform has it."""
    wanted, found = [*needed("robot-offload"), *EXTRAS], dict[str, None]()
    while wanted:
        name = normalised(wanted.pop())
        if name in found:
            continue
        try:
            distribution(name)
        except ModuleNotFoundError:
            continue  # for another platform
        found[name] = None
        wanted += needed(name)
    return sorted(found)


def _files(library: Distribution) -> Iterable[tuple[str, bytes]]:
    for file in library.files or ():
        where = file.as_posix()
        if not _LEFT_OUT.search(where) and not _TYPED.search(where):
            yield where, Path(str(library.locate_file(file))).read_bytes()


def _own_metadata(ours: Distribution) -> Iterable[tuple[str, bytes, int]]:
    """Return the metadata of our own package, which `--version` reads."""
    version = ours.version
    text = f"Metadata-Version: 2.1\nName: robot-offload\nVersion: {version}\nLicense-Expression: Apache-2.0\n"
    return [(f"lib/robot_offload-{version}.dist-info/METADATA", text.encode(), 0o644)]


def manifest(folder: Path, version: str, url: str) -> str:
    """Return krew's manifest for all archives in a folder.

    Args:
        folder: with the archives.
        version: of the release.
        url: of the folder that the release is published in.
    """
    platforms: list[dict[str, Any]] = []
    for path in sorted(folder.glob(f"{PLUGIN}-*.tar.gz")):
        found = _ARCHIVE.fullmatch(path.name)
        assert found is not None, path
        platforms.append(
            {
                "selector": {"matchLabels": {"os": found["os"], "arch": found["arch"]}},
                "uri": f"{url}/{path.name}",
                "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                "bin": PLUGIN,
            }
        )
    spec = {
        "version": f"v{version}",
        "homepage": "https://robotoffload.dev",
        "shortDescription": SHORT,
        "description": DESCRIPTION,
        "caveats": CAVEATS,
        "platforms": platforms,
    }
    return str(yaml.safe_dump({**MANIFEST, "spec": spec}, sort_keys=False, width=120))
