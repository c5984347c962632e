"""The page of the figures: docs/benchmarks-e2e.md. Pure but for the machine that it names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robot_offload_lab.bench.machine import describe, load, today
from tests.e2e.figures import Figure, shown

TITLES: Final[Mapping[str, str]] = {
    "first-drive": "From `kubectl apply` to driving in the cloud, and what the pods cost",
    "latency": "Ten topics at 10 Hz through each transport",
    "recovery": "After a cut",
}
NOTES: Final[Mapping[str, str]] = {
    "first-drive": "Images are on the nodes. Active is what the cloud's agent says of its nodes; the replicas stand by "
    "Hot, so that they become Active before there is a robot. The time of the robot begins with the start of its agent "
    "from the bundle and ends when the first command of the cloud reaches the consumer. Costs are those of 20 s of "
    "driving in the cloud.",
    "latency": "Half of a round trip through an echo in a pod, less the delay that the wire is told to make. "
    "`direct DDS` is the same program without agents, on a machine with routes to the pods. Zenoh goes through NAT and "
    "mutual TLS.",
    "recovery": "Both directions are cut; the time begins when the wire is mended.",
}
AIMS: Final[Mapping[str, str]] = {
    "apply to all cloud nodes Active, median": "5",
    "Zenoh, wire 0 ms: added one way p50": "2.5 (must 4)",
    "Zenoh, wire 0 ms: added one way p99": "6 (must 12)",
    "Zenoh, wire 10 ms: added one way p50": "2.5 (must 4)",
    "Zenoh, wire 10 ms: added one way p99": "6 (must 12)",
}


def text(figures: Sequence[Figure], *, quick: bool) -> str:
    """The whole page.

    Args:
        figures: of the run.
        quick: whether repetitions and windows were short.
    """
    machine = describe()
    lines = [
        "# Measured on a real cluster",
        "",
        (
            f"Written by `python -m tests.e2e.bench{' --quick' if quick else ''}` (`make bench-e2e`) on "
            f"{today()}. Two nodes out of namespaces, the robot outside the cluster "
            "behind a wire in user space: all of it shares one machine, so everything here is an upper bound."
        ),
        "",
        (
            f"Machine: {machine['cores']} cores ({machine['processor']}), {machine['memory_gb']} GB, "
            f"{machine['system']}, Python {machine['python']}; {_versions(machine)}. Load at the end: {load():.1f}."
        ),
    ]
    for group in dict.fromkeys(each.story for each in figures):
        lines += ["", f"## {TITLES.get(group, group)}", "", NOTES.get(group, ""), ""]
        lines += ["| what | measured | aim |", "|---|---|---|"]
        lines += [_row(each) for each in figures if each.story == group]
    return "\n".join(lines) + "\n"


def _versions(machine: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {version}" for name, version in machine["versions"].items())


def _row(figure: Figure) -> str:
    aim = next((each for name, each in AIMS.items() if figure.name.startswith(name)), "")
    return f"| {figure.name} | {shown(figure.value)} {figure.unit}".rstrip() + f" | {aim} |"
