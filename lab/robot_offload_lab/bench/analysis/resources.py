"""What the robot's agent costs: processor time and memory of all its processes, the supervisor included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import Figure, GroupResult, Priority

GROUP: Final = "resources"
CPU_MUST: Final = 15.0
CPU_AIM: Final = 8.0
PSS_MUST_MB: Final = 180.0
PSS_AIM_MB: Final = 120.0
MB: Final = 1e6


@dataclass(frozen=True)
class Usage:
    """One process at one moment.

    Attributes:
        name: as shown by ps.
        cpu_s: processor time used so far.
        pss_bytes: proportional set size: shared pages count in shares.
        anonymous_bytes: the part of it that no file backs.
        file_bytes: by mapped file, how much of it is in memory for this process.
    """

    name: str
    cpu_s: float
    pss_bytes: int
    anonymous_bytes: int
    file_bytes: Mapping[str, int]


@dataclass(frozen=True)
class Cost:
    """One process over the whole time."""

    name: str
    cpu_percent: float
    pss_mb: float


def usage(comm: str, stat: str, smaps_rollup: str, smaps: str, *, ticks_per_s: int) -> Usage:
    """From the files of a process in /proc, see proc(5)."""
    fields = stat.rpartition(")")[2].split()
    sizes = _sizes(smaps_rollup)
    return Usage(
        name=comm.strip(),
        cpu_s=(int(fields[11]) + int(fields[12])) / ticks_per_s,  # utime and stime
        pss_bytes=sizes["Pss"],
        anonymous_bytes=sizes["Pss_Anon"],
        file_bytes=_files(smaps),
    )


def _sizes(text: str) -> dict[str, int]:
    """Lines such as `Pss:   123 kB` in bytes."""
    words = (line.split() for line in text.splitlines())
    return {found[0].rstrip(":"): int(found[1]) * 1024 for found in words if len(found) == 3 and found[2] == "kB"}


def _files(smaps: str) -> dict[str, int]:
    """Resident bytes of every mapped piece of a file, by file and offset; copied (anonymous) pages are not its own."""
    found: dict[str, int] = {}
    piece = ""
    for line in smaps.splitlines():
        words = line.split()
        if not words[0].endswith(":"):  # a new mapping: addresses, rights, offset, device, inode and path
            piece = f"{words[5]}@{words[2]}" if len(words) > 5 and words[5].startswith("/") else ""
        elif piece and words[0] in ("Rss:", "Anonymous:"):
            sign = 1 if words[0] == "Rss:" else -1
            found[piece] = found.get(piece, 0) + sign * int(words[1]) * 1024
    return found


def costs(before: Sequence[Usage], after: Sequence[Usage], seconds: float) -> tuple[Cost, ...]:
    """Per process; both lists are of the same processes in the same order."""
    return tuple(
        Cost(late.name, (late.cpu_s - early.cpu_s) / seconds * 100, late.pss_bytes / MB)
        for early, late in zip(before, after, strict=True)
    )


def alone_mb(usages: Sequence[Usage]) -> float:
    """Returns what the same processes would hold with no other program on the machine to share files with.

    Anonymous pages are shared only within the agent (it forks), so their proportional parts add up. Of each file the
    most that one process holds is taken.
    """
    files: dict[str, int] = {}
    for usage in usages:
        for name, held in usage.file_bytes.items():
            files[name] = max(files.get(name, 0), held)
    return (sum(usage.anonymous_bytes for usage in usages) + sum(files.values())) / MB


def outcome(
    case: BenchCase, priority: Priority, before: Sequence[Usage], after: Sequence[Usage], seconds: float
) -> GroupResult:
    """Returns the figures of one observation."""
    found = costs(before, after, seconds)
    conditions = f"{load(case)}, {seconds:.0f} s"
    shares = ", ".join(f"{cost.name.removeprefix('ro-robot-')} {cost.cpu_percent:.1f}" for cost in found)
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(
            Figure(
                "cpu", "Processor time of the robot's agent, all processes", conditions, None, len(found),
                sum(cost.cpu_percent for cost in found), "% of a core", CPU_MUST, CPU_AIM, note=shares,
            ),
            Figure(
                "pss", "Memory of the robot's agent, all processes (PSS)", conditions, None, len(found),
                sum(cost.pss_mb for cost in found), "MB", PSS_MUST_MB, PSS_AIM_MB,
                note=f"{alone_mb(after):.0f} MB on a machine with no other program to share libraries with",
            ),
        ),
        parts=(),
        samples=tuple(asdict(cost) for cost in found),
    )  # fmt: skip


def load(case: BenchCase) -> str:
    """Returns what the agent was busy with."""
    rates = sorted({case.sensor_rate_hz, case.cloud_rate_hz, case.robot_rate_hz})
    shown = " and ".join(f"{rate:g}" for rate in rates)
    return f"{len(case.sensors)} topics to the cloud and the command at {shown} Hz, beats at 50 Hz"
