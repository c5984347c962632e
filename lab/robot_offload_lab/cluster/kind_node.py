"""A node that is a Docker container. It can lose its power or its network and get it back."""

from __future__ import annotations

import datetime as dt
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.error import HTTPError

from robot_offload_lab.cluster import kind_docker, netns, policies
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.kind_layout import KindLayout
from robot_offload_lab.cluster.kind_plane import KindPlane

PATIENCE = 180.0  # seconds; a node is ready after some, but the machine may be busy with a build
_IMPORT_S = 600.0


class KindNode:
    """One node of a cluster of kind.

    Attributes:
        name: In Kubernetes, and of its container.
        address: In the cluster's network.
    """

    def __init__(self, name: str, layout: KindLayout, plane: KindPlane) -> None:
        self.name = name
        self._layout = layout
        self._plane = plane
        self._since = dt.datetime.now(dt.UTC)
        self._imported: dict[Path, tuple[int, int]] = {}
        self.address = kind_docker.address(name, layout.kind)

    @property
    def netns(self) -> str:
        """Its network namespace."""
        return self._layout.netns(self.name)

    def connect(self) -> None:
        """Name its network like ours, and add the route to robots; Docker sets only the route to this machine."""
        self.address = kind_docker.address(self.name, self._layout.kind)
        netns.attach(self.netns, int(kind_docker.run("inspect", "--format", "{{.State.Pid}}", self.name)))
        netns.ip(f"route replace {self._layout.everything} via {self._layout.router}", netns=self.netns)

    def power_on(self) -> None:
        """Start it; `wait_ready` waits until the node works."""
        self._since = dt.datetime.now(dt.UTC)
        kind_docker.run("start", self.name)
        self.connect()

    def power_off(self) -> None:
        """Cut the power: everything on the node ends at once, without notice."""
        kind_docker.run("kill", self.name)
        netns.remove(self.netns)

    def partition(self) -> None:
        """Cut it off the network; it runs on."""
        netns.ip(f"link set {self._port()} nomaster")

    def heal(self) -> None:
        """Put it back on the network."""
        self._since = dt.datetime.now(dt.UTC)
        netns.ip(f"link set {self._port()} master {self._layout.kind}")

    def wait_ready(self) -> None:
        """Wait until it has reported since it was switched on or healed, and Kubernetes considers it ready."""
        self._wait(lambda: self._plane.node_reported_after(self.name, self._since) and self.is_ready())

    def is_ready(self) -> bool:
        """Return whether Kubernetes considers it ready; a failure is noticed after a while."""
        return self._plane.node_is_ready(self.name)

    def has_power(self) -> bool:
        """Return whether it is switched on."""
        return kind_docker.running(self.name)

    def enforces_policies(self) -> bool:
        """Return whether our rules for NetworkPolicies hold for its pods."""
        return policies.in_force(self.netns)

    def import_images(self, archives: Sequence[Path]) -> None:
        """Import OCI archives unless it has them already."""
        for archive in archives:
            status = archive.stat()
            version = (status.st_mtime_ns, status.st_size)
            if self._imported.get(archive) != version:
                with archive.open("rb") as content:
                    take = ("ctr", "--namespace=k8s.io", "images", "import", "-")
                    kind_docker.run("exec", "--interactive", self.name, *take, stdin=content, limit=_IMPORT_S)
                self._imported[archive] = version

    def reap(self) -> None:
        """Do nothing: none of its processes is our child."""

    def _port(self) -> str:
        """Return this machine's end of its cable."""
        wanted = json.loads(netns.run("ip", "-json", "link", "show", "eth0", netns=self.netns))[0]["link_index"]
        for port in json.loads(netns.run("ip", "-json", "link", "show")):
            if port["ifindex"] == wanted:
                return str(port["ifname"])
        raise ClusterError(f"The cable of {self.name} does not end on this machine. Is Docker on another one?")

    def _wait(self, happened: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while True:
            trouble = "not yet"
            try:
                if happened():
                    return
            except OSError as error:  # of the API server
                trouble = str(error)
                if isinstance(error, HTTPError):
                    error.close()
            if time.monotonic() > deadline:
                said = kind_docker.run("logs", "--tail", "20", self.name)
                raise ClusterError(f"Waited {PATIENCE:.0f} s for {self.name} to be ready: {trouble}\n{said}")
            time.sleep(0.1)
