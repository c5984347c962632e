"""Network namespaces and what is in them, by the `ip`, `nft` and `nsenter` commands."""

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
"""Of this process's own network namespace."""

TIDY = (
    "net.ipv6.conf.all.disable_ipv6=1",
    "net.ipv6.conf.default.disable_ipv6=1",
    # A network namespace answers for its addresses only where they are: cut off is cut off.
    "net.ipv4.conf.all.arp_ignore=1",
)


def into(netns: str) -> tuple[str, ...]:
    """Return command that runs another one in there.

    Not `ip netns exec`, which mounts /sys anew and so hides the cgroups.
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
    """Load rules; all of them or, when one is wrong, none."""
    run("nft", "-f", "-", netns=netns, stdin=rules)


def make(netns: str, *, forwards: bool = False) -> None:
    """Make a namespace with its loopback interface up."""
    run("ip", "netns", "add", netns)
    settings = [*TIDY, f"net.ipv4.ip_forward={int(forwards)}"]
    run("sysctl", "-q", "-w", *settings, netns=netns)
    ip("link set lo up", netns=netns)


def attach(netns: str, pid: int) -> None:
    """Give the namespace of a process a name; in place of what had this name before."""
    if exists(netns):
        run("ip", "netns", "del", netns)
    run("ip", "netns", "attach", netns, str(pid))


def exists(netns: str) -> bool:
    """Return whether there is one of this name."""
    return (NAMED / netns).exists()


def named(prefix: str) -> list[str]:
    """Return namespaces whose name begins like this."""
    return sorted(path.name for path in NAMED.glob(f"{prefix}*")) if NAMED.is_dir() else []


def inhabitants(netns: str) -> list[int]:
    """Return processes that are in a namespace."""
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
    """Kill every process in a namespace of ours; how many there were.

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
    """Send a signal to processes of which some may be gone already."""
    for pid in pids:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            continue


def remove(netns: str) -> None:
    """Remove a namespace with all that is in it; no matter when there is none."""
    if not exists(netns):
        return
    empty(netns)
    # One end of a pair goes with its namespace only later, when the kernel gets to it; a new cluster may be faster.
    links = run("ip", "-o", "link", "show", "type", "veth", netns=netns).splitlines()
    for line in links:
        name = line.split(":")[1].strip().split("@")[0]
        subprocess.run([*into(netns), "ip", "link", "del", name], capture_output=True, check=False)
    run("ip", "netns", "del", netns)
