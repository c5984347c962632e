"""A base image without a container registry: Debian by debootstrap, this very CPython, and ROS 2 as wheels.

It stands in for `ros:jazzy` and `ros:jazzy-ros-core` in tests and on offline machines; see `images/wheels-base`. Needs
root and debootstrap. The two archives are kept, because making them takes minutes.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, TypeAlias

from robot_offload.errors import InputError
from robot_offload.images.builders import BuildError, Request, Tool, run

Stage: TypeAlias = Literal["system", "ros-core", "ros-compilers", "ros-base"]

STAGES: Final[tuple[Stage, ...]] = ("system", "ros-core", "ros-compilers", "ros-base")
RELEASE: Final = "bookworm"
MIRROR: Final = "http://deb.debian.org/debian"
# What CPython links, and the certificates.
PACKAGES: Final = (
    "ca-certificates", "libssl3", "libffi8", "libsqlite3-0", "libbz2-1.0", "liblzma5", "zlib1g", "libreadline8",
    "libuuid1", "libncursesw6",
)  # fmt: skip
BUNDLE: Final = "/etc/ssl/certs/ca-certificates.crt"
TIMEOUT_S: Final = 1800.0
PYTHON: Final = "python3.12"
_NOT_OF_SYSTEM: Final = re.compile(
    r"(var/cache/apt|var/lib/apt/lists|var/log|usr/share/(doc|man|locale|info)|dev|proc|sys|debootstrap)/.+"
)
_OF_PYTHON: Final = re.compile(rf"(bin/(python3|{PYTHON})|lib(/.*)?)")
_NOT_OF_PYTHON: Final = re.compile(
    rf"(.*/__pycache__(/.*)?|.*\.a|lib/pkgconfig(/.*)?|lib/{PYTHON}/(test|idlelib|site-packages)/.+)"
)


def tag(stage: Stage) -> str:
    """Return the name of a stage's image; it belongs to this machine."""
    return f"{_name(stage)}:jazzy"


def _name(stage: Stage) -> str:
    return f"localhost/robot-offload/wheels-{stage}"


def build(
    tool: Tool,
    root: Path,
    extra: tuple[str, ...] = (),
    stages: Iterable[Stage] = STAGES,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Build stages; unchanged ones come from the builder's cache.

    Args:
        tool: the builder.
        root: of the repository.
        extra: further arguments of the builder.
        stages: those that are needed.
        environment: of the builder; None: this process's own.

    Raises:
        InputError: this machine lacks what it needs.
        BuildError: debootstrap or the builder failed.
    """
    kept = archives(cache_folder())
    with tempfile.TemporaryDirectory(prefix="robot-offload-wheels-") as folder:
        context = Path(folder)
        shutil.copytree(root / "images" / "wheels-base", context, dirs_exist_ok=True)
        text = (root / "requirements" / "all.txt").read_text(encoding="utf-8")
        (context / "constraints.txt").write_text(constraints(text), encoding="utf-8")
        _lend_headers(context / "include")
        names = {stage: f"{_name(stage)}:{fingerprint(context, kept)}" for stage in STAGES if stage in set(stages)}
        missing = [stage for stage, name in names.items() if not _is_there(tool, name, environment)]
        for archive in kept if missing else ():
            shutil.copy2(archive, context)
        request = Request(tag="", context=context, dockerfile=str(context / "Dockerfile"), extra=extra)
        for stage in missing:
            wanted = replace(request, tag=names[stage], extra=("--target", stage, *extra))
            run(tool, wanted, environment=environment)
    for stage, name in names.items():
        subprocess.run((tool, "tag", name, tag(stage)), check=True, timeout=60.0, env=environment)


def _lend_headers(folder: Path) -> None:
    """Copy the interpreter's own headers: the system's headers belong to another version."""
    headers = Path(sysconfig.get_path("include"))
    folder.mkdir()
    if headers.is_dir():  # without them only the stage with compilers is useless
        shutil.copytree(headers, folder, dirs_exist_ok=True)


def fingerprint(context: Path, kept: Iterable[Path]) -> str:
    """Return a name that changes with each file of the context, and when an archive is made anew."""
    digest = hashlib.sha256()
    for path in sorted(path for path in context.rglob("*") if path.is_file()):
        digest.update(str(path.relative_to(context)).encode() + b"\0" + path.read_bytes())
    for path in kept:
        state = path.stat()
        digest.update(f"{path.name} {state.st_size} {state.st_mtime_ns}".encode())
    return digest.hexdigest()[:16]


def _is_there(tool: Tool, image: str, environment: Mapping[str, str] | None) -> bool:
    """Return whether an image exists already, which is quicker than having the builder check the archives again."""
    command = (tool, "images", "--quiet", image)
    asked = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0, env=environment)
    return asked.returncode == 0 and bool(asked.stdout.strip())


def lent(tool: Tool) -> tuple[str, ...]:
    """Return builder arguments that give a build this machine's trusted certificates, without a user namespace.

    An intercepting proxy has certificates of its own, which the machine knows and the base does not. docker cannot pass
    a file: it takes the proxy from its own settings.
    """
    if tool == "docker":
        return ()
    certificates = ("--volume", f"{BUNDLE}:{BUNDLE}:ro") if Path(BUNDLE).exists() else ()
    return ("--isolation", "chroot", *certificates)


def constraints(requirements: str) -> str:
    """Return the pinned versions without hashes and conditions: pip accepts hashes for everything or nothing."""
    return "".join(f"{pin}\n" for pin in re.findall(r"^[A-Za-z0-9_.-]+==[^\s;\\]+", requirements, re.MULTILINE))


def archives(folder: Path) -> tuple[Path, Path]:
    """Return the archives of the system and of CPython, made if they are not in `folder` yet.

    Raises:
        InputError: this is not CPython 3.12, or root or debootstrap is missing.
        BuildError: debootstrap failed.
    """
    system, python = _paths(folder)
    for path, write in ((system, _write_system), (python, _write_python)):
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_suffix(f".{os.getpid()}")
            write(unfinished)
            unfinished.rename(path)
    return system, python


def archives_are_kept() -> bool:
    """Return whether both archives exist, so that debootstrap is not needed."""
    return all(path.exists() for path in _paths(cache_folder()))


def _paths(folder: Path) -> tuple[Path, Path]:
    return folder / f"{RELEASE}/system.tar", folder / f"{sys.version.split()[0]}/python.tar"


def _write_system(path: Path) -> None:
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        raise InputError("a base image of one's own needs root and debootstrap; install it, or name a base with --base")
    with tempfile.TemporaryDirectory(prefix="robot-offload-system-") as folder:
        command = ("debootstrap", "--variant=minbase", f"--include={','.join(PACKAGES)}", RELEASE, folder, MIRROR)
        done = subprocess.run(command, check=False, timeout=TIMEOUT_S, stdout=sys.stderr)
        if done.returncode != 0:
            raise BuildError(f"debootstrap ended with {done.returncode}; its last lines above say why")
        pack(Path(folder), path, of_system)


def pack(folder: Path, path: Path, chosen: Callable[[tarfile.TarInfo], tarfile.TarInfo | None]) -> None:
    """Write the chosen files of a folder into an archive."""
    with tarfile.open(path, "w") as archive:
        archive.add(folder, arcname="", filter=chosen)


def of_system(member: tarfile.TarInfo) -> tarfile.TarInfo | None:
    """Select all of Debian except caches, logs and manuals."""
    return None if _NOT_OF_SYSTEM.fullmatch(member.name) else member


def _write_python(path: Path) -> None:
    if sys.version_info[:2] != (3, 12):
        raise InputError("the ROS wheels are for CPython 3.12; run this with python3.12")
    if sys.base_prefix == "/usr":
        # Its library is spread over the system and built for another release.
        raise InputError("the system's own Python cannot be taken along; use one of pyenv or `uv python install 3.12`")
    pack(Path(sys.base_prefix), path, of_python)


def of_python(member: tarfile.TarInfo) -> tarfile.TarInfo | None:
    """Select the interpreter and its library, placed in /usr/local and owned by root."""
    kept = member.name in ("", "bin") or _OF_PYTHON.fullmatch(member.name)
    if not kept or _NOT_OF_PYTHON.fullmatch(member.name):
        return None
    member.name = f"usr/local/{member.name}"
    member.uid = member.gid = 0
    member.uname = member.gname = "root"
    return member


def cache_folder() -> Path:
    """Return where the archives are kept."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "robot-offload" / "images"
