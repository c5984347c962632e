"""Network namespaces and their contents, by the `ip`, `nft` and `nsenter` commands."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterable
from pathlib import Path

from robot_offload_lab.cluster.errors import ClusterError

NAMED = Path("/run/netns")
INTERFACES = Path("/sys/class/net")
"""Interfaces of this process's own network namespace."""

TIDY = (
    "net.ipv6.conf.all.disable_ipv6=1",
    "net.ipv6.conf.default.disable_ipv6=1",
    # A network namespace answers for an address only on the address's interface, so that a cut really cuts.
    "net.ipv4.conf.all.arp_ignore=1",
)


def into(netns: str) -> tuple[str, ...]:
    """Return a command prefix that runs another command in a namespace.

    Not `ip netns exec`, which remounts /sys and so hides the cgroups.
    """
    return ("nsenter", f"--net={NAMED / netns}")


def run(*command: str, netns: str = "", stdin: str | None = None) -> str:
    """Run a command, in a network namespace if one is named, and return its output.

    Raises:
        ClusterError: It failed.
    """
    prefix = into(netns) if netns else ()
    done = subprocess.run([*prefix, *command], input=stdin, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ClusterError(f"{' '.join(command)}{f' in {netns}' if netns else ''}: {done.stderr.strip()}")
    return done.stdout


def ip(*lines: str, netns: str = "") -> None:
    """Run several `ip` commands at once, without the word `ip`."""
    run("ip", "-batch", "-", netns=netns, stdin="\n".join(lines) + "\n")


def nft(rules: str, netns: str) -> None:
    """Load rules: all of them, or none if one is wrong."""
    run("nft", "-f", "-", netns=netns, stdin=rules)


def make(netns: str, *, forwards: bool = False) -> None:
    """Make a namespace with its loopback interface up."""
    run("ip", "netns", "add", netns)
    settings = [*TIDY, f"net.ipv4.ip_forward={int(forwards)}"]
    run("sysctl", "-q", "-w", *settings, netns=netns)
    ip("link set lo up", netns=netns)


def attach(netns: str, pid: int) -> None:
    """Give the namespace of a process a name, replacing the earlier bearer of the name."""
    if exists(netns):
        run("ip", "netns", "del", netns)
    run("ip", "netns", "attach", netns, str(pid))


def exists(netns: str) -> bool:
    """Return whether a namespace of this name exists."""
    return (NAMED / netns).exists()


def named(prefix: str) -> list[str]:
    """Return the namespaces whose name has this prefix."""
    return sorted(path.name for path in NAMED.glob(f"{prefix}*")) if NAMED.is_dir() else []


def inhabitants(netns: str) -> list[int]:
    """Return the processes in a namespace."""
    try:
        wanted = (NAMED / netns).stat().st_ino
    except FileNotFoundError:
        return []
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and (entry / "ns" / "net").stat().st_ino == wanted:
                found.append(int(entry.name))
        except OSError:  # it has just ended
            continue
    return found


def empty(netns: str, patience: float = 60.0) -> int:
    """Kill every process in a namespace of ours; return how many there were.

    Args:
        netns: The namespace.
        patience: Seconds to wait until they are gone.
    """
    deadline = time.monotonic() + patience
    killed: set[int] = set()
    while pids := inhabitants(netns):
        signal_all(pids)
        killed.update(pids)
        if time.monotonic() > deadline:
            raise ClusterError(f"These processes in {netns} do not end: {pids}")
        time.sleep(0.02)
    return len(killed)


def signal_all(pids: Iterable[int], number: signal.Signals = signal.SIGKILL) -> None:
    """Send a signal to processes, some of which may have ended already."""
    for pid in pids:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            continue


def remove(netns: str) -> None:
    """Remove a namespace with everything in it; do nothing if there is none."""
    if not exists(netns):
        return
    empty(netns)
    # The kernel removes one end of a pair only some time after its namespace; a new cluster may come sooner.
    links = run("ip", "-o", "link", "show", "type", "veth", netns=netns).splitlines()
    for line in links:
        name = line.split(":")[1].strip().split("@")[0]
        subprocess.run([*into(netns), "ip", "link", "del", name], capture_output=True, check=False)
    run("ip", "netns", "del", netns)
