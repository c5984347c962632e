"""What the stories need of any kind of cluster: its API, its nodes, and machines outside it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Protocol, Self

from robot_offload_lab.cluster import ownership, processes
from robot_offload_lab.cluster.commands import Helm, Kubectl
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import Layout
from robot_offload_lab.cluster.nodes_plane import NodesPlane
from robot_offload_lab.cluster.ownership import Leftovers
from robot_offload_lab.cluster.robot_host import NatRobot, Neighbour, RobotHost

ROOT = Path(__file__).parents[3]
PATIENCE = 60.0  # seconds for what takes half of one


class AnyNode(Protocol):
    """A node that can lose its power or its network, and get it back."""

    @property
    def name(self) -> str:
        """In Kubernetes."""
        ...

    @property
    def address(self) -> str:
        """In the cluster's network."""
        ...

    def power_off(self) -> None:
        """Cut the power: everything on the node ends at once, without notice."""
        ...

    def power_on(self) -> None:
        """Start it; `wait_ready` waits until the node works."""
        ...

    def partition(self) -> None:
        """Cut it off the network; it runs on."""
        ...

    def heal(self) -> None:
        """Put it back on the network."""
        ...

    def wait_ready(self) -> None:
        """Wait until it has reported since it was switched on or healed, and Kubernetes considers it ready."""
        ...

    def is_ready(self) -> bool:
        """Return whether Kubernetes considers it ready; a failure is noticed after a while."""
        ...

    def has_power(self) -> bool:
        """Return whether it is switched on."""
        ...

    def enforces_policies(self) -> bool:
        """Return whether our rules for NetworkPolicies hold for its pods."""
        ...

    def import_images(self, archives: Sequence[Path]) -> None:
        """Import OCI archives."""
        ...

    def reap(self) -> None:
        """Wait for its remaining processes after all were killed."""
        ...


class AnyCluster:
    """A running cluster.

    Attributes:
        number: Its number among the clusters that can run side by side.
        layout: Its names and addresses.
        plane: Its control plane.
        nodes: The nodes that run pods, by name.
        tester: Program to test a network with (`pods/tester`); in pods it is the image `TESTER`.
    """

    def __init__(self, layout: Layout, plane: NodesPlane, *, die_with_us: bool, lock: IO[str] | None = None) -> None:
        self.number = layout.number
        self.layout = layout
        self.plane = plane
        self.nodes: Mapping[str, AnyNode] = {}
        self.tester = Path()
        self._hosts: dict[str, RobotHost] = {}
        self._attendant: subprocess.Popen[bytes] | None = None
        self._die_with_us = die_with_us
        self._lock = lock

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.down()

    @property
    def hosts(self) -> Mapping[str, RobotHost]:
        """Its robots and neighbours by name."""
        return self._hosts

    @property
    def kubeconfig(self) -> Path:
        """The administrator's file; the cluster's address can be reached from this machine."""
        return self.plane.kubeconfig

    def kubectl(self, namespace: str = "default") -> Kubectl:
        """Run kubectl as the administrator."""
        return self.plane.kubectl(namespace)

    def helm(self, namespace: str = "default") -> Helm:
        """Run helm as the administrator."""
        return self.plane.helm(namespace)

    def down(self) -> Leftovers:
        """End it and remove everything but the kept images, which stay for the next cluster of this number.

        Returns:
            What is left: nothing.
        """
        ownership.remove(self.layout)
        self.plane.stop()
        for node in self.nodes.values():
            node.reap()
        for host in self._hosts.values():
            host.reap()
        if self._attendant is not None:
            self._attendant.wait()
        if self._lock is not None:
            self._lock.close()
        return ownership.leftovers(self.layout)

    def import_images(self, *archives: Path) -> None:
        """Import OCI archives into every node, unless it has them already."""
        paths = [each.resolve() for each in archives]
        # A thread per node: unpacking keeps one core busy. The threads start nothing that must outlive them.
        with ThreadPoolExecutor() as pool:
            list(pool.map(lambda node: node.import_images(paths), self.nodes.values()))

    def robot(self, name: str, *, realtime: bool = True) -> RobotHost:
        """Return a machine outside, behind a wire and NAT: it reaches load balancer addresses, but cannot be reached.

        Args:
            name: Up to 20 of a-z, 0-9 and -.
            realtime: Its wire runs with real-time priority.
        """
        return self._add_host(NatRobot, name, realtime=realtime)

    def neighbour(self, name: str, *, realtime: bool = True) -> RobotHost:
        """Return a machine in the cluster's own network, behind a wire: it reaches pods and pods reach it.

        Args:
            name: Up to 20 of a-z, 0-9 and -.
            realtime: Its wire runs with real-time priority.
        """
        return self._add_host(Neighbour, name, realtime=realtime)

    @contextmanager
    def without_api(self) -> Iterator[None]:
        """Take the API server down for the block; everything else keeps running."""
        self.plane.stop_api()
        try:
            yield
        finally:
            self.plane.start_api()

    def enforce_policies(self, enforce: bool) -> None:
        """Enforce NetworkPolicies, as from the start, or let everything pass; return when that is in effect.

        Raises:
            NotHereError: This cluster cannot change that.
        """
        if enforce:
            self.layout.unenforced.unlink(missing_ok=True)
        else:
            self.layout.unenforced.touch()
        deadline = time.monotonic() + PATIENCE
        while not all(node.enforces_policies() == enforce for node in self.nodes.values() if node.has_power()):
            if time.monotonic() > deadline:
                raise ClusterError(f"The attendant does not follow; see {self.layout.home}/attendant.log")
            time.sleep(0.05)

    def _attend(self) -> None:
        program = [sys.executable, "-m", "robot_offload_lab.cluster.attendant", f"--marker={self.layout.marker}"]
        # Independent of the caller's working directory.
        command = ["env", f"PYTHONPATH={ROOT}", *program]
        log = self.layout.home / "attendant.log"
        self._attendant = processes.spawn(command, log, die_with_us=self._die_with_us, favoured=True)

    def _add_host(self, kind: type[NatRobot | Neighbour], name: str, *, realtime: bool) -> RobotHost:
        if name in self._hosts:
            raise ClusterError(f"There is a machine {name} already")
        taken = {host.index for host in self._hosts.values()}
        index = next(each for each in range(1, 60) if each not in taken)
        host = self._hosts[name] = kind(self.layout, name, index, die_with_us=self._die_with_us, gone=self._forget)
        host.build(realtime=realtime)
        return host

    def _forget(self, name: str) -> None:
        del self._hosts[name]
