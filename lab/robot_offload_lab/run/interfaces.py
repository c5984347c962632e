"""Interface packages built on the spot, such as a user's own: with generators and a compiler, no build system.

The wheels hold the generators that `rosidl_generate_interfaces` runs; their command line stumbles over entry points
that the wheels name twice, so they are called one by one. A process that uses the package needs `environment`.

    python -m robot_offload_lab.run.interfaces TARGET FOLDER...

makes the packages of FOLDERs below TARGET, as an image holds them, with a TARGET/setup.bash to source.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import importlib.metadata
import io
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_adapter.srv import convert_srv_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_generator_type_description.cli import HashTypeDescription
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

from robot_offload.errors import RobotOffloadError


def _prefix() -> Path:
    """Return where ROS 2 itself is: in a sourced installation, or among the wheels of this environment."""
    sourced = [Path(text) for text in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if text]
    return next((path for path in sourced if (path / "include" / "rosidl_runtime_c").is_dir()), Path(sys.prefix))


PREFIX = _prefix()
SUPPORT = "rosidl_typesupport_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
LIBRARIES = ("rosidl_generator_c", "rosidl_typesupport_fastrtps_c", INTROSPECTION, SUPPORT, "rosidl_generator_py")


_CONVERT = {".msg": convert_msg_to_idl, ".srv": convert_srv_to_idl, ".action": convert_action_to_idl}


class InterfacesError(RobotOffloadError):
    """An interface package could not be made."""


@dataclass(frozen=True)
class Package:
    """An interface package: its name, and its definitions by path, as IDL."""

    name: str
    interfaces: dict[str, str]

    def sources(self) -> dict[str, str]:
        """Return the sources of each library."""
        return {
            "rosidl_generator_c": f"{self.name}/*/detail/*.c",
            "rosidl_typesupport_fastrtps_c": f"{self.name}/*/detail/*__type_support_c.cpp",
            INTROSPECTION: f"{INTROSPECTION}/{self.name}/*/detail/*.c",
            SUPPORT: f"{self.name}/*/*__type_support.cpp",
            "rosidl_generator_py": f"{self.name}/*/_*_s.c",
            "extension": f"{self.name}/_*_s.ep.{SUPPORT}.c",
        }


TF2_MSGS = Package(
    "tf2_msgs",
    {
        "msg/TFMessage.idl": """#include "geometry_msgs/msg/TransformStamped.idl"
module tf2_msgs { module msg {
  struct TFMessage { sequence<geometry_msgs::msg::TransformStamped> transforms; };
}; };
""",
    },
)
"""What `geometry_msgs/TransformStamped[] transforms` of tf2_msgs/msg/TFMessage.msg becomes; tf2_msgs has no wheel."""


def read(folder: Path) -> Package:
    """Return the package in a folder of its name, with `.msg`, `.srv` and `.action` files as anywhere in ROS 2.

    Raises:
        InterfacesError: a file has no definition that can be read, or there is none.
    """
    folder, found = folder.resolve(), {}
    with tempfile.TemporaryDirectory(prefix="ro-") as temporary, contextlib.redirect_stdout(io.StringIO()):
        for path in sorted(folder.glob("*/*")):
            if path.suffix not in _CONVERT:
                continue
            relative = path.relative_to(folder)
            try:
                _CONVERT[path.suffix](folder, folder.name, relative, Path(temporary))
            except Exception as error:  # the parser raises many kinds
                raise InterfacesError(f"{path}: {error}") from error
            found[str(relative.with_suffix(".idl"))] = (Path(temporary) / f"{path.stem}.idl").read_text()
    if not found:
        raise InterfacesError(f"{folder}: no interface; write for example {folder.name}/srv/Ask.srv")
    return Package(folder.name, found)


def cached(package: Package) -> Path:
    """Return the folder for the search paths, from the user's cache, where a package is made once.

    Raises:
        InterfacesError: there is no compiler, or the compiler refuses.
    """
    target = _place(package)
    if not is_cached(package):
        target.parent.mkdir(parents=True, exist_ok=True)
        # Made beside and renamed: a half-made package is never found, and two makers do not collide.
        with tempfile.TemporaryDirectory(prefix="making-", dir=target.parent) as temporary:
            make(Path(temporary), package)
            with contextlib.suppress(OSError):  # another process was faster
                Path(temporary).rename(target)
            Path(temporary).mkdir(exist_ok=True)
    return target / "made"


def is_cached(package: Package) -> bool:
    """Return whether the package is in the user's cache already."""
    return (_place(package) / "made").exists()


def _place(package: Package) -> Path:
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "robot-offload" / "interfaces" / f"{package.name}-{_fingerprint(package)}"


def _fingerprint(package: Package) -> str:
    """Return what distinguishes packages: definitions, and the versions of what generates code from them."""
    versions = sorted(f"{it.name} {it.version}" for it in importlib.metadata.distributions() if "rosidl" in it.name)
    text = repr((package, versions, sys.version))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def make(folder: Path, package: Package) -> Path:
    """Build a package below a folder; return the folder for the search paths. This takes some seconds.

    Raises:
        InterfacesError: there is no compiler, or the compiler refuses.
    """
    name = package.name
    source, made = folder / "source" / name, folder / "made"
    _generate(package, folder, source, folder / "source" / INTROSPECTION / name)
    modules = made / name
    modules.parent.mkdir(parents=True)
    for path in source.rglob("*.py"):
        target = modules / path.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(path.read_text())
    found = {kind: sorted((folder / "source").glob(pattern)) for kind, pattern in package.sources().items()}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        ready = {
            kind: [pool.submit(_compile, folder / "source", path) for path in paths] for kind, paths in found.items()
        }
        objects = {kind: [each.result() for each in waiting] for kind, waiting in ready.items()}
    for kind in LIBRARIES:
        _link(objects[kind], made / f"lib{name}__{kind}.so", made)
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    _link(objects["extension"], modules / f"{name}_s__{SUPPORT}{suffix}", made)
    return made


def load(made: Path, package: Package) -> None:
    """Let this process find the package's libraries: it started before LD_LIBRARY_PATH could include them."""
    for kind in LIBRARIES:
        ctypes.CDLL(str(made / f"lib{package.name}__{kind}.so"))


def environment(*made: Path) -> dict[str, str]:
    """Return the variables with which a process finds the packages."""
    paths = ":".join(map(str, made))
    return {name: f"{paths}:{os.environ.get(name, '')}".strip(":") for name in ("PYTHONPATH", "LD_LIBRARY_PATH")}


def _generate(package: Package, folder: Path, source: Path, introspection: Path) -> None:
    """Write all sources. The generators read input relative to the working folder; two write files of one name."""
    name = package.name
    for file, text in package.interfaces.items():
        path = folder / "idl" / name / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    before, shared = Path.cwd(), [str(PREFIX / "share")]
    os.environ.setdefault("AMENT_PREFIX_PATH", str(PREFIX))
    os.chdir(folder / "idl" / name)
    try:
        files = list(package.interfaces)
        HashTypeDescription("hash").generate_type_hashes(name, files, shared, output_path=folder / "hash")
        hashes = [str((folder / "hash" / file).with_suffix(".json")) for file in files]
        GenerateC("c").generate(name, files, shared, output_path=source, type_description_files=hashes)
        GenerateIntrospectionCTypesupport("introspection").generate(name, files, shared, output_path=introspection)
        supports = ["rosidl_typesupport_fastrtps_c", INTROSPECTION]
        for generator in (
            GenerateFastRTPSCTypesupport("fastrtps"),
            GenerateCTypesupport("c", typesupport_implementations=supports),
            GeneratePython("py", typesupport_implementations=[SUPPORT]),
        ):
            generator.generate(name, files, shared, output_path=source)
    finally:
        os.chdir(before)


def _compile(source: Path, path: Path) -> Path:
    headers = PREFIX / "include"
    roots = [headers, *headers.iterdir(), Path(sysconfig.get_path("include")), Path(np.get_include())]
    includes = [f"-I{root}" for root in (source / INTROSPECTION, source, *roots)]
    compiler = "c++" if path.suffix == ".cpp" else "cc"
    _run([compiler, "-O0", "-fPIC", "-w", *includes, "-c", str(path), "-o", f"{path}.o"])
    return Path(f"{path}.o")


def _link(objects: Sequence[Path], target: Path, made: Path) -> None:
    lent = [f"-l:{path.name}" for kind in ("c", "py") for path in (PREFIX / "lib").glob(f"lib*__rosidl*_{kind}.so")]
    others = ["rosidl_runtime_c", "rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c", "fastcdr", "rmw", "rcutils"]
    own = [f"-l:{path.name}" for path in made.glob("*.so") if path != target]
    where = [f"-L{made}", f"-L{PREFIX / 'lib'}", f"-Wl,-rpath,{made}", f"-Wl,-rpath,{PREFIX / 'lib'}"]
    libraries = [*own, *lent, *(f"-l{name}" for name in others)]
    linker = ["c++", "-shared", f"-Wl,-soname,{target.name}", "-o", str(target)]
    _run([*linker, *map(str, objects), *where, *libraries])


def _run(command: Sequence[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise InterfacesError(f"{command[0]}: no such program; install a C and C++ compiler") from error
    if done.returncode:
        raise InterfacesError(f"{' '.join(command)}\n{done.stderr}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Make packages as an image holds them; return the exit code."""
    target, *folders = map(Path, sys.argv[1:] if arguments is None else arguments)
    made = []
    for folder in folders:
        package = read(folder)
        made.append(make(target / package.name, package))
        for path in made[-1].parent.iterdir():
            if path != made[-1]:
                shutil.rmtree(path)
    # The environment at build time is not that of the image.
    lines = [
        f'export {name}="{":".join(map(str, made))}${{{name}:+:${name}}}"\n'
        for name in ("PYTHONPATH", "LD_LIBRARY_PATH")
    ]
    (target / "setup.bash").write_text("".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
