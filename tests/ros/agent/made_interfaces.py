"""An interface package made on the spot, as a user's own is: generators and a compiler, without a build system.

The wheels hold the generators that `rosidl_generate_interfaces` runs; their command line stumbles over entry points
that the wheels name twice, so they are called one by one. A process that uses the package needs `environment`.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_generator_type_description.cli import HashTypeDescription
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

PACKAGE = "made_on_the_spot"
PREFIX = Path(sys.prefix)
SUPPORT = "rosidl_typesupport_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
LIBRARIES = ("rosidl_generator_c", "rosidl_typesupport_fastrtps_c", INTROSPECTION, SUPPORT, "rosidl_generator_py")
INTERFACES = {
    "action/Dig.idl": """#include "builtin_interfaces/msg/Time.idl"
module made_on_the_spot { module action {
  struct Dig_Goal { builtin_interfaces::msg::Time started; sequence<double> depths; };
  struct Dig_Result { string done; };
  struct Dig_Feedback { uint32 spoonfuls; double depth; };
}; };
""",
    "srv/Ask.idl": """module made_on_the_spot { module srv {
  struct Ask_Request { string question; };
  struct Ask_Response { boolean success; string answer; };
}; };
""",
}


def make(folder: Path) -> Path:
    """Builds the package below a folder; returns what has to be on the search paths. Takes some seconds."""
    source, made = folder / "source" / PACKAGE, folder / "made"
    _generate(folder, source, folder / "source" / INTROSPECTION / PACKAGE)
    package = made / PACKAGE
    package.parent.mkdir(parents=True)
    for path in source.rglob("*.py"):
        target = package / path.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(path.read_text())
    found = {kind: sorted((folder / "source").glob(pattern)) for kind, pattern in _SOURCES.items()}
    with ThreadPoolExecutor() as pool:
        objects = dict(zip(found, pool.map(_compile, found.values()), strict=True))
    for kind in LIBRARIES:
        _link(objects[kind], made / f"lib{PACKAGE}__{kind}.so", made)
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    _link(objects["extension"], package / f"{PACKAGE}_s__{SUPPORT}{suffix}", made)
    return made


def load(made: Path) -> None:
    """Lets this process find the package's libraries: it began before LD_LIBRARY_PATH could say where they are."""
    for kind in LIBRARIES:
        ctypes.CDLL(str(made / f"lib{PACKAGE}__{kind}.so"))


def environment(made: Path) -> dict[str, str]:
    """The variables of a process that finds the package."""
    return {name: f"{made}:{os.environ.get(name, '')}".rstrip(":") for name in ("PYTHONPATH", "LD_LIBRARY_PATH")}


_SOURCES = {
    "rosidl_generator_c": f"{PACKAGE}/*/detail/*.c",
    "rosidl_typesupport_fastrtps_c": f"{PACKAGE}/*/detail/*__type_support_c.cpp",
    INTROSPECTION: f"{INTROSPECTION}/{PACKAGE}/*/detail/*.c",
    SUPPORT: f"{PACKAGE}/*/*__type_support.cpp",
    "rosidl_generator_py": f"{PACKAGE}/*/_*_s.c",
    "extension": f"{PACKAGE}/_*_s.ep.{SUPPORT}.c",
}


def _generate(folder: Path, source: Path, introspection: Path) -> None:
    """Writes all sources. The generators read their input relative to the working folder; two write the same names."""
    for name, text in INTERFACES.items():
        path = folder / "idl" / PACKAGE / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    before, shared = Path.cwd(), [str(PREFIX / "share")]
    os.environ.setdefault("AMENT_PREFIX_PATH", str(PREFIX))
    os.chdir(folder / "idl" / PACKAGE)
    try:
        files = list(INTERFACES)
        HashTypeDescription("hash").generate_type_hashes(PACKAGE, files, shared, output_path=folder / "hash")
        hashes = [str((folder / "hash" / name).with_suffix(".json")) for name in files]
        GenerateC("c").generate(PACKAGE, files, shared, output_path=source, type_description_files=hashes)
        GenerateIntrospectionCTypesupport("introspection").generate(PACKAGE, files, shared, output_path=introspection)
        supports = ["rosidl_typesupport_fastrtps_c", INTROSPECTION]
        for generator in (
            GenerateFastRTPSCTypesupport("fastrtps"),
            GenerateCTypesupport("c", typesupport_implementations=supports),
            GeneratePython("py", typesupport_implementations=[SUPPORT]),
        ):
            generator.generate(PACKAGE, files, shared, output_path=source)
    finally:
        os.chdir(before)


def _compile(sources: Iterable[Path]) -> list[Path]:
    headers = PREFIX / "include"
    roots = [headers, *headers.iterdir(), Path(sysconfig.get_path("include")), Path(np.get_include())]
    objects = []
    for path in sources:
        compiler = "c++" if path.suffix == ".cpp" else "cc"
        source = path.parents[len(path.parts) - path.parts.index("source") - 2]
        includes = [f"-I{root}" for root in (source / INTROSPECTION, source, *roots)]
        _run([compiler, "-O0", "-fPIC", "-w", *includes, "-c", str(path), "-o", f"{path}.o"])
        objects.append(Path(f"{path}.o"))
    return objects


def _link(objects: Sequence[Path], target: Path, made: Path) -> None:
    lent = [f"-l:{path.name}" for kind in ("c", "py") for path in (PREFIX / "lib").glob(f"lib*__rosidl*_{kind}.so")]
    others = ["rosidl_runtime_c", "rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c", "fastcdr", "rmw", "rcutils"]
    own = [f"-l:{path.name}" for path in made.glob("*.so") if path != target]
    where = [f"-L{made}", f"-L{PREFIX / 'lib'}", f"-Wl,-rpath,{made}", f"-Wl,-rpath,{PREFIX / 'lib'}"]
    libraries = [*own, *lent, *(f"-l{name}" for name in others)]
    linker = ["c++", "-shared", f"-Wl,-soname,{target.name}", "-o", str(target)]
    _run([*linker, *map(str, objects), *where, *libraries])


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stderr}"
