"""Whether this machine can run a cluster with nodes, and if not, why."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from robot_offload_lab.cluster import cgroups, programs

PACKAGES = {
    "containerd": "containerd",
    "ctr": "containerd",
    "runc": "runc",
    "ip": "iproute2",
    "nft": "nftables",
    "conntrack": "conntrack",
    "sysctl": "procps",
    "nsenter": "util-linux",
    "unshare": "util-linux",
    "setpriv": "util-linux",
}
NETWORK_PLUGINS = Path("/usr/lib/cni")
BRIDGE_FILTER = Path("/proc/sys/net/bridge/bridge-nf-call-iptables")


def preflight() -> str | None:
    """Return why nodes cannot run on this machine, and the next step; None when they can."""
    if not sys.platform.startswith("linux"):
        return "Nodes are made of Linux namespaces, and this is not Linux. Next: use a Linux machine."
    if os.geteuid() != 0:
        return "Nodes are made of namespaces and control groups, for which one must be root. Next: run it with sudo."
    lacking = sorted({package for program, package in PACKAGES.items() if shutil.which(program) is None})
    if not all((NETWORK_PLUGINS / each).exists() for each in ("bridge", "host-local", "loopback", "portmap")):
        lacking.append("containernetworking-plugins")
    if lacking:
        return f"These packages are missing: {', '.join(lacking)}. Next: apt-get install {' '.join(lacking)}"
    return _kernel() or _programs()


def _kernel() -> str | None:
    if absent := cgroups.missing():
        return f"A kubelet needs the control groups {', '.join(sorted(absent))}, and they are not mounted here."
    test = subprocess.run(
        ["unshare", "--net", "--mount", "--pid", "--fork", "--uts", "true"], capture_output=True, text=True, check=False
    )
    if test.returncode:
        return f"This machine does not let us make namespaces: {test.stderr.strip()}"
    if not _can_overlay():
        return (
            f"Images are kept in layers, and {programs.cache()} lies where overlayfs cannot. Next: set XDG_CACHE_HOME"
        )
    if not BRIDGE_FILTER.exists():
        subprocess.run(["modprobe", "br_netfilter"], capture_output=True, check=False)
    if not BRIDGE_FILTER.exists():
        return "The kernel module br_netfilter is missing: Services would not work between pods of one node."
    rules = "add table inet robot_offload_preflight\ndelete table inet robot_offload_preflight\n"
    test = subprocess.run(["nft", "-f", "-"], input=rules, capture_output=True, text=True, check=False)
    if test.returncode:
        return f"The kernel takes no nftables rules: {test.stderr.strip()}"
    return None


def _can_overlay() -> bool:
    """Return whether containerd can use overlays on the cache's file system; it cannot inside a container, say."""
    programs.cache().mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="overlay-", dir=programs.cache()) as place:
        for each in ("lower", "upper", "work", "whole"):
            (Path(place) / each).mkdir()
        layers = f"lowerdir={place}/lower,upperdir={place}/upper,workdir={place}/work"
        command = ["unshare", "--mount", "mount", "-t", "overlay", "-o", layers, "overlay", f"{place}/whole"]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0


def _programs() -> str | None:
    if shutil.which("go") or programs.built():
        return None
    return "The cluster must be built once and Go is not installed. Next: install Go 1.25 or newer (https://go.dev/dl)"
