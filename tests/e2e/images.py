"""The images of a cluster under test: our own, built as the product builds them, and one with the example nodes.

They are kept as OCI archives, keyed by everything that they are made of. A build after a change writes only the layers
that no archive holds yet, so that nodes import those alone.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from robot_offload.errors import InputError
from robot_offload.images.builders import Request, run
from robot_offload_lab.images import ours, wheels_base

REPOSITORY: Final = "localhost/robot-offload"
APP: Final = "app"
AGENT: Final = "agent"
OURS: Final = (AGENT, "operator", "discovery")
INTERFACES: Final = "localhost/robot-offload/e2e-interfaces:jazzy"
_INPUTS: Final = (
    "images",
    "core",
    "agent",
    "operator",
    "lab",
    "examples",
    "state",
    "requirements/all.txt",
    "tests/e2e/apps",
)
_NO_INPUTS: Final = ("__pycache__", ".egg-info", ".pytest_cache", ".mypy_cache")
_OF_BENCH: Final = tuple(
    f"robot_offload_lab/{name}.py"
    for name in (
        "__init__", "bench/__init__", "bench/kinds", "bench/observed",
        "bench/parts/__init__", "bench/parts/node", "bench/parts/echo", "bench/parts/kinds_source",
    )
)  # fmt: skip
"""What the echo of the benches is made of: it needs ROS and nothing else."""
_LARGEST_DELTA_BYTES: Final = 100_000_000
"""When a change makes more than this new, a complete archive is written, so that no long chain of them grows."""
CHOSEN: Final = "ROBOT_OFFLOAD_E2E_IMAGES"
"""Environment variable: the key of images that were built before, or `newest`; nothing is built then."""

Say = Callable[[str], None]
_compiled: Final = shutil.ignore_patterns("__pycache__")


@dataclass(frozen=True, slots=True)
class Images:
    """What the nodes of a cluster need.

    Attributes:
        references: by name (`agent`, `operator`, `discovery`, `app`), as pods name them.
        archives: what to import, in this order; a later one may lack the layers that an earlier one holds.
    """

    references: Mapping[str, str]
    archives: tuple[Path, ...]


def provide(say: Say) -> Images:
    """The images of the present source, built where no archive holds them yet.

    Args:
        say: told what takes long.

    Raises:
        RobotOffloadError: they cannot be built here; the message says why.
    """
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    key = _chosen(folder) or _key(_files(ours.ROOT))
    references = {name: f"{REPOSITORY}/{name}:{key}" for name in (*OURS, APP)}
    with (folder / "lock").open("w") as gate:
        fcntl.flock(gate, fcntl.LOCK_EX)  # two builds into one store, or of one archive, would be one too many
        kept = _kept(folder, key)
        if kept is None:
            say("building the images; the first time takes five to ten minutes, after a change of the source seconds")
            _build(folder, references, key)
            kept = _export(folder, references, key)
    return Images(references, kept)


def provide_example(name: str, say: Say) -> Images:
    """The images `examples/NAME` and `examples/NAME-agent`, as `make images` builds them; for one story.

    Args:
        name: of the example, which has interface packages of its own.
        say: told what takes long.

    Raises:
        RobotOffloadError: they cannot be built here; the message says why.
    """
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    key = _key(_files(ours.ROOT))
    wanted = [image for image in ours.OURS if image.example == name]
    settings = ours.BuildSettings(REPOSITORY, key, key, extra=wheels_base.lent("buildah"))
    references = {image.name: ours.request(image, settings).tag for image in wanted}
    with (folder / "lock").open("w") as gate:
        fcntl.flock(gate, fcntl.LOCK_EX)
        kept = _kept(folder, f"{key}-{name}")
        if kept is None:
            say(f"building the images of {name}; the first time makes its interface packages, a minute")
            environment = builder_environment(folder)
            stages: tuple[wheels_base.Stage, ...] = ("ros-core", ours.COMPILERS)
            wheels_base.build("buildah", ours.ROOT, settings.extra, stages=stages, environment=environment)
            for image in wanted:
                base, compilers = ours.stand_in(image, wheels=True), wheels_base.tag(ours.COMPILERS)
                run("buildah", ours.request(image, settings, base, compilers), environment=environment)
            kept = _export(folder, references, f"{key}-{name}")
    return Images(references, kept)


def cache_folder() -> Path:
    """Where archives and the builder's own store are kept."""
    return wheels_base.cache_folder().parent / "e2e-images"


def _chosen(folder: Path) -> str:
    """What the environment asks for, so that an edit meanwhile costs no build; empty: the present source."""
    wanted = os.environ.get(CHOSEN, "")
    if wanted == "newest":
        notes = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)
        complete = [note.stem for note in notes if "-" not in note.stem]  # the others are of one example
        return complete[-1] if complete else ""
    if wanted and not (folder / f"{wanted}.json").exists():
        raise InputError(f"{CHOSEN}={wanted}: no images of that key are in {folder}; leave it out to build them")
    return wanted


def renamed(images: Images, others: Mapping[str, str], folder: Path) -> Path:
    """Returns an archive that gives images that the nodes have other names; it holds nothing else."""
    with tarfile.open(images.archives[-1]) as opened:
        member = opened.extractfile("index.json")
        assert member is not None
        index: dict[str, Any] = json.load(member)
    entries = {name: entry for entry in index["manifests"] for name in entry["annotations"].values()}
    renamed = [
        {**entries[name], "annotations": {"org.opencontainers.image.ref.name": other}} for name, other in others.items()
    ]
    archive = folder / "renamed.tar"
    with tarfile.open(archive, "w") as written:
        for name, content in (
            ("oci-layout", {"imageLayoutVersion": "1.0.0"}),
            ("index.json", {**index, "manifests": renamed}),
        ):
            text = json.dumps(content).encode()
            about = tarfile.TarInfo(name)
            about.size = len(text)
            written.addfile(about, io.BytesIO(text))
    return archive


# -- what they are made of --------------------------------------------------------------------------------------------


def _files(root: Path) -> Iterator[Path]:
    """Every file that a build may read."""
    for name in _INPUTS:
        path = root / name
        found = sorted(path.rglob("*")) if path.is_dir() else [path]
        yield from (each for each in found if each.is_file() and not any(no in str(each) for no in _NO_INPUTS))


def _key(files: Iterable[Path]) -> str:
    """A name for the contents of these files and this interpreter, short enough for a tag."""
    digest = hashlib.sha256(sys.version.encode())
    for path in files:
        digest.update(f"{path.relative_to(ours.ROOT)} {path.stat().st_mode & 0o777:o}\n".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:12]


# -- building ---------------------------------------------------------------------------------------------------------


def _build(folder: Path, references: Mapping[str, str], key: str) -> None:
    """Builds every image into the builder's store; what has not changed comes from there."""
    environment = builder_environment(folder)
    settings = ours.BuildSettings(REPOSITORY, key, key, extra=wheels_base.lent("buildah"))
    stages = tuple(dict.fromkeys(image.wheels_stage for image in _ours() if image.wheels_stage))
    wheels_base.build("buildah", ours.ROOT, settings.extra, stages=stages, environment=environment)
    run("buildah", _interfaces(settings), environment=environment)
    for image in _ours():
        assert image.wheels_stage is not None
        base = INTERFACES if image.name == AGENT else wheels_base.tag(image.wheels_stage)
        run("buildah", ours.request(image, settings, base), environment=environment)
    with tempfile.TemporaryDirectory(prefix="robot-offload-app-") as context:
        _fill_app(Path(context))
        run("buildah", _app(Path(context), references[APP], settings), environment=environment)


def _ours() -> tuple[ours.OwnImage, ...]:
    return tuple(image for image in ours.OURS if image.name in OURS)


def _app(context: Path, tag: str, settings: ours.BuildSettings) -> Request:
    return Request(
        tag=tag,
        context=context,
        dockerfile=str(ours.ROOT / "tests/e2e/apps/Dockerfile"),
        build_arguments={"BASE": INTERFACES},
        extra=settings.extra,
    )


def _interfaces(settings: ours.BuildSettings) -> Request:
    """What nodes and agent are laid over: ROS with the actions of the stories, as a user's base has the user's."""
    folder = ours.ROOT / "tests/e2e/apps"
    return Request(
        tag=INTERFACES,
        context=folder,
        dockerfile=str(folder / "interfaces.Dockerfile"),
        build_arguments={"BASE": wheels_base.tag("ros-core")},
        extra=settings.extra,
    )


def _fill_app(context: Path) -> None:
    """All nodes in one folder, because the samples name them so: `python3 talker.py`."""
    for source in ("examples/talker", "examples/wheelchair", "tests/e2e/apps"):
        for path in (ours.ROOT / source).glob("*.py"):
            shutil.copy2(path, context)
    shutil.copytree(ours.ROOT / "state" / "robot_offload_state", context / "robot_offload_state", ignore=_compiled)
    for name in _OF_BENCH:
        (context / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ours.ROOT / "lab" / name, context / name)


def builder_environment(folder: Path) -> dict[str, str]:
    """The builder's, with a store of its own: the machine's images are left alone."""
    store = folder / "store"
    (store / "tmp").mkdir(parents=True, exist_ok=True)
    (store / "storage.conf").write_text(
        f'[storage]\ndriver = "overlay"\ngraphroot = "{store}/root"\nrunroot = "{store}/run"\n', encoding="utf-8"
    )
    return os.environ | {"CONTAINERS_STORAGE_CONF": str(store / "storage.conf"), "TMPDIR": str(store / "tmp")}


# -- archives ---------------------------------------------------------------------------------------------------------


def _kept(folder: Path, key: str) -> tuple[Path, ...] | None:
    """The archives that hold the images of this key; None when one of them is missing."""
    note = folder / f"{key}.json"
    if not note.exists():
        return None
    archives = tuple(folder / name for name in json.loads(note.read_text(encoding="utf-8")))
    return archives if all(each.exists() for each in archives) else None


def _export(folder: Path, references: Mapping[str, str], key: str) -> tuple[Path, ...]:
    """Writes what the newest complete archive does not hold, or a complete one."""
    # Kept from run to run: the builder compresses only those layers that are not there yet.
    layout = folder / "layout"
    for reference in references.values():
        command = ("buildah", "push", "--quiet", reference, f"oci:{layout}:{reference}")
        subprocess.run(command, check=True, timeout=600.0, env=builder_environment(folder))
    index = json.loads((layout / "index.json").read_text(encoding="utf-8"))
    index["manifests"] = [entry for entry in index["manifests"] if _name(entry) in references.values()]
    blobs = dict(_reachable(layout, index))
    base, held = _newest_complete(folder)
    new = {name: path for name, path in blobs.items() if name not in held}
    complete = base is None or sum(path.stat().st_size for path in new.values()) > _LARGEST_DELTA_BYTES
    archive = folder / f"{key}{'-complete' if complete else ''}.tar"
    _write(archive, index, blobs if complete else new)
    names = [archive.name] if complete or base is None else [base.name, archive.name]
    (folder / f"{key}.json").write_text(json.dumps(names), encoding="utf-8")
    _forget_old(folder, keep=names)
    _tidy(layout, index, blobs)
    return tuple(folder / name for name in names)


def _name(entry: Mapping[str, Any]) -> str:
    return str(entry.get("annotations", {}).get("org.opencontainers.image.ref.name", ""))


def _reachable(layout: Path, index: Mapping[str, Any]) -> Iterator[tuple[str, Path]]:
    """Every blob that these images are made of."""
    for entry in index["manifests"]:
        manifest_path = _blob(layout, entry["digest"])
        manifest = json.loads(manifest_path.read_text(encoding="utf-8"))
        for each in (entry, manifest["config"], *manifest["layers"]):
            path = _blob(layout, each["digest"])
            yield path.name, path


def _blob(layout: Path, digest: str) -> Path:
    return layout / "blobs" / digest.replace(":", "/")


def _tidy(layout: Path, index: Mapping[str, Any], blobs: Mapping[str, Path]) -> None:
    """Only the newest images stay in the layout; the archives hold the others."""
    (layout / "index.json").write_text(json.dumps(index), encoding="utf-8")
    for path in (layout / "blobs" / "sha256").iterdir():
        if path.name not in blobs:
            path.unlink()


def _newest_complete(folder: Path) -> tuple[Path | None, frozenset[str]]:
    """The newest archive that lacks nothing, and the blobs in it."""
    found = sorted(folder.glob("*-complete.tar"), key=lambda path: path.stat().st_mtime)
    if not found:
        return None, frozenset()
    with tarfile.open(found[-1]) as archive:
        return found[-1], frozenset(Path(name).name for name in archive.getnames() if name.startswith("blobs/"))


def _write(archive: Path, index: Mapping[str, Any], blobs: Mapping[str, Path]) -> None:
    """An OCI archive; it appears under its name when it is whole."""
    unfinished = archive.with_suffix(f".{os.getpid()}")
    with tarfile.open(unfinished, "w") as written:
        for name, text in (("oci-layout", '{"imageLayoutVersion": "1.0.0"}'), ("index.json", json.dumps(index))):
            member = tarfile.TarInfo(name)
            member.size = len(text.encode())
            written.addfile(member, io.BytesIO(text.encode()))
        for name, path in sorted(blobs.items()):
            written.add(path, arcname=f"blobs/sha256/{name}")
    unfinished.rename(archive)


def _forget_old(folder: Path, keep: Iterable[str]) -> None:
    """Archives and notes of earlier sources: the newest eight stay, they are what one goes back to."""
    notes = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)
    for note in notes[:-8]:
        note.unlink()
    needed = {name for note in folder.glob("*.json") for name in json.loads(note.read_text())} | set(keep)
    for archive in folder.glob("*.tar"):
        if archive.name not in needed:
            archive.unlink()
