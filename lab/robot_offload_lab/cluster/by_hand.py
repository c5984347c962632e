"""Clusters with nodes on the command line: the commands of `python -m robot_offload_lab.cluster`."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, get_args

from robot_offload_lab.cluster import ownership, processes, programs
from robot_offload_lab.cluster.cluster import Cluster
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import NUMBERS, Layout
from robot_offload_lab.cluster.netns import into
from robot_offload_lab.cluster.wire import Cut

NUMERIC = ("delay_ms", "jitter_ms", "loss_pct", "rate_kbit")


def find(home: Path, say: programs.Say) -> Cluster | None:
    """Return the cluster with nodes that was started under a name; None when there is none."""
    layout = ownership.by_hand(home)
    return None if layout is None else Cluster.of(layout, say)


def needed(home: Path, say: programs.Say) -> Cluster:
    """Return the cluster that was started under a name; it must exist."""
    cluster = find(home, say)
    if cluster is None:
        raise ClusterError(
            "There is no cluster with nodes of this name. Next: python -m robot_offload_lab.cluster up --nodes 2"
        )
    return cluster


def up(home: Path, nodes: int, number: int | None, say: programs.Say) -> Cluster:
    """Start a cluster that runs until `down`."""
    if (there := ownership.by_hand(home)) is not None:
        raise ClusterError(
            f"It is running already, as cluster {there.number}. Next: python -m robot_offload_lab.cluster down"
        )
    return Cluster.up(nodes=nodes, number=number, by_hand=home, say=say)


def down(home: Path, say: programs.Say) -> bool:
    """End the cluster of this name, also after a crash, and remove leftovers; return whether there was one."""
    layout = ownership.by_hand(home)
    if layout is not None:
        ownership.remove(layout)
        left = ownership.leftovers(layout)
        say(f"cluster {layout.number} removed; left: {left}" if left else f"cluster {layout.number} removed")
    for each in ownership.sweep():
        say(f"also removed cluster {each.number}, left by a test run that was killed")
    return layout is not None


def status() -> list[str]:
    """Return one line for each cluster with nodes on this machine."""
    lines = []
    for layout in ownership.known():
        state = "in use" if ownership.is_alive(layout) else "left by a run that was killed; next: down"
        count = ownership.leftovers(layout)
        lines.append(f"cluster {layout.number}: {state}, {count.processes} processes, {count.netns} namespaces")
    return lines


def node(cluster: Cluster, name: str, what: str) -> None:
    """Switch a node on or off, cut it off or heal it."""
    if name not in cluster.nodes:
        raise ClusterError(f"There is no node {name!r}, but: {', '.join(cluster.nodes)}")
    chosen = cluster.nodes[name]
    {"off": chosen.power_off, "on": chosen.power_on, "cut": chosen.partition, "heal": chosen.heal}[what]()
    if what in ("on", "heal"):
        chosen.wait_ready()


def robot(cluster: Cluster, name: str, what: str, rest: Sequence[str]) -> str:
    """Make, steer, use or remove a machine outside the cluster; return the text to print."""
    if what in ("add", "neighbour"):
        host = (cluster.robot if what == "add" else cluster.neighbour)(name)
        return f"{name} has the address {host.address}"
    if name not in cluster.hosts:
        raise ClusterError(f"There is no robot {name!r}. Next: python -m robot_offload_lab.cluster robot {name} add")
    host = cluster.hosts[name]
    if what == "run":
        _become(host.netns, rest)
    if what == "wire":
        host.wire.set(**link(rest))
        return str(host.wire.state())
    if what == "play":
        return f"playing {host.wire.play(Path(rest[0])):.1f} s"
    if what == "move":
        return f"{name} has the address {host.change_address()}"
    host.remove()
    return f"{name} removed"


def link(words: Sequence[str]) -> dict[str, Any]:
    """Return settings of a wire from words like `delay_ms=10` and `cut=both`; `cut=` heals."""
    found: dict[str, Any] = {}
    for word in words:
        key, _, value = word.partition("=")
        if key == "cut" and value in (*get_args(Cut), ""):
            found[key] = value or None
        elif key in NUMERIC and value.replace(".", "", 1).isdigit():
            found[key] = float(value)
        else:
            raise ClusterError(
                f"{word!r} is not a setting of a wire: use {', '.join(NUMERIC)} with a number, or cut=both"
            )
    return found


def clean() -> list[Path]:
    """Remove the kept images of all clusters that do not run; return where they were."""
    running = {layout.number for layout in ownership.known()}
    kept = [Layout(number).kept for number in NUMBERS if number not in running]
    there = [path for path in kept if path.exists()]
    for path in there:
        shutil.rmtree(path)
    return there


def environment() -> Mapping[str, str]:
    """Return our environment for a program that talks to a cluster."""
    return processes.without_proxies(os.environ)


def _become(netns: str, command: Sequence[str]) -> NoReturn:
    """Replace this process by a program on a robot."""
    if not command:
        raise ClusterError("What is to run there? For example: robot NAME run ip address")
    words = [*into(netns), *command]
    os.execvpe(words[0], words, environment())
