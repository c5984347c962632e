"""A real Kubernetes on this machine: control plane, nodes, names, load balancer, robots outside. See `Cluster.up`."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import yaml

from robot_offload_lab.cluster import network, ownership, programs, robot_host, system_images
from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import MOST_NODES, Layout
from robot_offload_lab.cluster.node import ClusterNode
from robot_offload_lab.cluster.node_files import NodeFiles
from robot_offload_lab.cluster.nodes_plane import NodesPlane
from robot_offload_lab.cluster.preflight import preflight

_FACTS = "cluster.json"
NAMES = Path(__file__).with_name("coredns.yaml")


class Cluster(AnyCluster):
    """A cluster of our own: its nodes are namespaces of this machine.

    Attributes:
        nodes: By name.
    """

    nodes: Mapping[str, ClusterNode]

    def __init__(self, layout: Layout, plane: NodesPlane, *, die_with_us: bool, lock: IO[str] | None = None) -> None:
        super().__init__(layout, plane, die_with_us=die_with_us, lock=lock)
        self.nodes = {}

    @classmethod
    def up(
        cls,
        *,
        nodes: int = 2,
        number: int | None = None,
        fast_failure: bool = True,
        by_hand: Path | None = None,
        say: programs.Say,
    ) -> Cluster:
        """Start one and return when its nodes and its DNS are ready: some ten seconds once the programs are built.

        Args:
            nodes: How many.
            number: 0 to 9: picks all names and addresses; the lowest free one when left out.
            fast_failure: A dead node is noticed after 9 s and its pods are moved 3 s later, not after 50 s and 5 min.
            by_hand: Directory by which the command line finds it; then it runs until `down`. When left out, no process
                outlives the thread that calls this: use the main thread.
            say: Receives one line of progress at a time.

        Raises:
            ClusterError: This machine cannot run it, or the number is taken.
        """
        if why := preflight():
            raise ClusterError(why)
        if not 1 <= nodes <= MOST_NODES:
            raise ClusterError(f"A cluster has 1 to {MOST_NODES} nodes, not {nodes}")
        servers, inside = programs.everything(say)
        layout, lock = ownership.claim(number, by_hand)
        plane = NodesPlane(layout, servers, fast_failure=fast_failure)
        cluster = cls(layout, plane, die_with_us=by_hand is None, lock=lock)
        try:
            cluster._start(nodes, inside, fast_failure, say)
        except BaseException:
            cluster.down()
            raise
        return cluster

    @classmethod
    def of(cls, layout: Layout, say: programs.Say) -> Cluster:
        """Return the cluster that another process has started by hand.

        Raises:
            ClusterError: There is none.
        """
        try:
            facts = json.loads((layout.home / _FACTS).read_text())
        except FileNotFoundError:
            raise ClusterError(
                f"No cluster {layout.number} with nodes. Next: python -m robot_offload_lab.cluster up --nodes 2"
            ) from None
        servers, inside = programs.everything(say)
        plane = NodesPlane(layout, servers, fast_failure=facts["fast_failure"]).attached()
        cluster = cls(layout, plane, die_with_us=False)
        cluster._know_nodes(facts["nodes"], inside, facts["fast_failure"])
        for name in sorted(path.name for path in layout.home.glob("wires/*")):
            cluster._hosts[name] = robot_host.of(layout, name, die_with_us=False, gone=cluster._forget)
        return cluster

    def _start(self, nodes: int, inside: programs.Programs, fast_failure: bool, say: programs.Say) -> None:
        begun = time.monotonic()

        def report(what: str) -> None:
            say(f"test cluster {self.number}: {what} after {time.monotonic() - begun:.1f} s")

        network.build(self.layout)
        self.plane.start(die_with_us=self._die_with_us)
        report("API server ready")
        self._attend()
        (self.layout.home / _FACTS).write_text(json.dumps({"nodes": nodes, "fast_failure": fast_failure}))
        self._know_nodes(nodes, inside, fast_failure)
        for node in self.nodes.values():
            node.install()
            node.boot()
        for node in self.nodes.values():
            node.start_kubelet()
        self.kubectl("").apply(*_name_server(self.layout))
        for node in self.nodes.values():
            node.wait_ready()
        report(f"{nodes} nodes ready")
        self.kubectl("kube-system")("wait", "--for=condition=Available", "deployment/coredns", "--timeout=120s")
        report("DNS ready")

    def _know_nodes(self, count: int, inside: programs.Programs, fast_failure: bool) -> None:
        self.tester = inside.path("tester")
        images = system_images.archives(inside)
        servers, pki = self.plane.programs.directory, self.plane.certificates
        files = [NodeFiles(self.layout, each, servers, pki, fast_failure) for each in range(1, count + 1)]
        self.nodes = {each.name: ClusterNode(each, self.plane, images, die_with_us=self._die_with_us) for each in files}


def _name_server(layout: Layout) -> Sequence[Mapping[str, Any]]:
    manifests = list(yaml.safe_load_all(NAMES.read_text()))
    service = next(each for each in manifests if each["kind"] == "Service")
    service["spec"]["clusterIP"] = layout.names_service
    return manifests
