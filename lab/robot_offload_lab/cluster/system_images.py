"""The images that every node has: the pause of each pod, CoreDNS, and the program of the cluster's own tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from robot_offload_lab.cluster import oci
from robot_offload_lab.cluster.programs import Programs

PAUSE = "localhost/pause:3.10"
OURS = "localhost/robot-offload/"
"""Prefix of images that are rebuilt here again and again, each time under another tag."""

TESTER = f"{OURS}tester:1"
IMAGES: Mapping[str, str] = {"pause": PAUSE, "coredns": "localhost/coredns:1", "tester": TESTER}


def archives(programs: Programs) -> Sequence[Path]:
    """Return the images' OCI archives; make missing ones beside the programs."""
    return [archive(programs, program) for program in IMAGES]


def archive(programs: Programs, program: str) -> Path:
    """Return the OCI archive of one program."""
    found = programs.directory / f"{program}.tar"
    if not found.exists():
        oci.write(found, IMAGES[program], programs.path(program))
    return found
