"""Processor time and memory of each pod, from the control groups of its node."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.e2e.figures import figure
from tests.e2e.story import Story

ROOT: Final = Path("/sys/fs/cgroup")
MEBIBYTE: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Reading:
    """What a pod has used so far.

    Attributes:
        name: the pod's, without the random letters at its end.
        t_s: when it was read, seconds.
        cpu_s: processor time.
        rss_bytes: memory that belongs to its processes alone.
    """

    name: str
    t_s: float
    cpu_s: float
    rss_bytes: int


def read(story: Story, name: str) -> dict[str, Reading]:
    """The pods of a RobotOffload, by uid."""
    found = {}
    for pod in story.pods(name):
        uid = pod["metadata"]["uid"]
        times, memory = _group("cpuacct", uid), _group("memory", uid)
        if times is None or memory is None:
            continue
        found[uid] = Reading(_plain(pod["metadata"]["name"]), time.monotonic(), _cpu_s(times), _rss_bytes(memory))
    return found


def tell(before: dict[str, Reading], after: dict[str, Reading]) -> None:
    """Prints what each pod used in between."""
    for uid, last in sorted(after.items(), key=lambda item: item[1].name):
        first = before.get(uid)
        if first is None:
            continue
        share = (last.cpu_s - first.cpu_s) / (last.t_s - first.t_s)
        figure(f"pod {last.name}: processor", share * 100.0, "% of a core")
        figure(f"pod {last.name}: memory", last.rss_bytes / MEBIBYTE, "MiB")


def _group(controller: str, uid: str) -> Path | None:
    """The control group of a pod, in either version of control groups."""
    hierarchy = ROOT / controller if (ROOT / controller).is_dir() else ROOT
    return next(iter(hierarchy.glob(f"*/kubepods/**/pod{uid}")), None)


def _cpu_s(group: Path) -> float:
    if (group / "cpuacct.usage").exists():
        return int((group / "cpuacct.usage").read_text()) / 1e9
    return _table(group / "cpu.stat")["usage_usec"] / 1e6


def _rss_bytes(group: Path) -> int:
    stat = _table(group / "memory.stat")
    return stat["total_rss"] if "total_rss" in stat else stat["anon"]


def _table(path: Path) -> dict[str, int]:
    return {key: int(value) for key, value in (line.split() for line in path.read_text().splitlines())}


def _plain(pod: str) -> str:
    """`wheelchair-agent` of `wheelchair-agent-7f9b7568b5-mhhvs`; a StatefulSet's pod keeps its number."""
    parts = pod.split("-")
    return "-".join(parts[:-2]) if len(parts) > 2 and len(parts[-1]) == 5 else pod
