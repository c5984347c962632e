"""A real Kubernetes in Docker containers, made by kind, with robots outside that are namespaces as usual."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from robot_offload_lab.cluster import (
    kind_docker,
    netns,
    network,
    ownership,
    preflight,
    processes,
    programs,
    system_images,
)
from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.errors import ClusterError, NotHereError
from robot_offload_lab.cluster.kind_config import configuration
from robot_offload_lab.cluster.kind_layout import MOST_NODES, KindLayout
from robot_offload_lab.cluster.kind_node import KindNode
from robot_offload_lab.cluster.kind_plane import KindPlane
from robot_offload_lab.cluster.programs import Programs, Say

IMAGE = "ROBOT_OFFLOAD_KIND_IMAGE"
"""Environment variable: the image of the nodes, in place of kind's own."""

CREATE_S = 900.0
_NEEDED = {name: programs.CONTROL_PLANE[name] for name in ("kubectl", "helm")}
_NOT_FOR_ROBOTS = ("containerd", "ctr", "runc")


def missing() -> str | None:
    """Return why kind cannot make a cluster on this machine, and the next step; None when it can."""
    if os.geteuid() != 0:
        return "Robots are namespaces of this machine, for which one must be root. Next: run it with sudo."
    if why := kind_docker.silent():
        return f"The nodes of kind are containers of Docker, and {why}. Next: install and start Docker."
    needed = {each: package for each, package in preflight.PACKAGES.items() if each not in _NOT_FOR_ROBOTS}
    lacking = sorted({package for program, package in needed.items() if shutil.which(program) is None})
    if lacking:
        return f"These packages are missing: {', '.join(lacking)}. Next: apt-get install {' '.join(lacking)}"
    if not shutil.which("go") and not shutil.which("kind"):
        return "There is no kind, and no Go to build it. Next: install kind (https://kind.sigs.k8s.io) or Go."
    return None


def prepare(say: Say) -> tuple[Path, Programs, Programs]:
    """Return kind and the programs that talk to a cluster and test its network; build what is missing."""
    installed = shutil.which("kind")
    kind = Path(installed) if installed else programs.ensure(say, programs.KIND, programs.KIND_MODULE).path("kind")
    tester = {"tester": programs.PODS["tester"]}
    return kind, programs.ensure(say, _NEEDED), programs.ensure(say, tester, programs.POD_MODULE)


class KindCluster(AnyCluster):
    """A running cluster of kind: a control plane, and the nodes (the term does not include the control plane)."""

    nodes: Mapping[str, KindNode]
    layout: KindLayout
    plane: KindPlane

    def __init__(self, layout: KindLayout, plane: KindPlane, *, lock: IO[str] | None = None) -> None:
        super().__init__(layout, plane, die_with_us=True, lock=lock)
        self.nodes = {}
        self._kindnet = True

    @classmethod
    def up(cls, *, nodes: int = 2, number: int | None = None, fast_failure: bool = True, say: Say) -> KindCluster:
        """Start one and return when its nodes and its DNS are ready: half a minute once Docker has the image.

        Args:
            nodes: How many, beside the control plane.
            number: 0 to 9: picks all names and addresses, as for clusters of our own; the lowest free one if left out.
            fast_failure: A dead node is noticed after 9 s and its pods are moved 3 s later, not after 50 s and 5 min.
            say: Receives one line of progress at a time.

        Raises:
            ClusterError: This machine cannot run it, or the number is taken.
        """
        if why := missing():
            raise ClusterError(why)
        if not 1 <= nodes <= MOST_NODES:
            raise ClusterError(f"A cluster of kind has 1 to {MOST_NODES} nodes beside its control plane, not {nodes}")
        kind, talkers, inside = prepare(say)
        claimed, lock = ownership.claim(number, None)
        layout = KindLayout(claimed.number)
        cluster = cls(layout, KindPlane(layout, talkers), lock=lock)
        cluster.tester = inside.path("tester")
        try:
            cluster._start(kind, nodes, inside, fast_failure=fast_failure, say=say)
        except BaseException:
            cluster.down()
            raise
        return cluster

    def enforce_policies(self, enforce: bool) -> None:
        """Enforce policies or not; kind's own network enforces them by itself and has no switch."""
        if not self._kindnet:
            super().enforce_policies(enforce)
        elif not enforce:
            raise NotHereError("kind's own network enforces NetworkPolicies and cannot be told not to")

    def _start(self, kind: Path, nodes: int, inside: Programs, *, fast_failure: bool, say: Say) -> None:
        begun = time.monotonic()

        def report(what: str) -> None:
            say(f"kind cluster {self.number}: {what} after {time.monotonic() - begun:.1f} s")

        self._build_network()
        self._create(kind, configuration(self.layout, nodes, fast_failure=fast_failure))
        report("made")
        self._know_nodes()
        self._kindnet = bool(self.kubectl("kube-system")("get", "daemonset/kindnet", "--ignore-not-found"))
        if self._kindnet:
            self.layout.unenforced.touch()  # by the attendant, as kind's network already does
        self._attend()
        for node in self.nodes.values():
            node.wait_ready()
        report(f"{nodes} nodes ready")
        self.import_images(system_images.archive(inside, "tester"))
        self.kubectl("kube-system")("wait", "--for=condition=Available", "deployment/coredns", "--timeout=120s")
        report("DNS ready")

    def _build_network(self) -> None:
        """Connect Docker's network, which is the cluster's, through the router with the robots' side."""
        layout = self.layout
        network.refuse_overlap(layout)
        kind_docker.refuse_strangers(layout)
        kind_docker.make_network(layout)
        if not (netns.INTERFACES / layout.kind).exists():
            raise ClusterError("Docker's networks are not on this machine, so no robot here can reach one")
        network.switchboard(layout)
        netns.ip(
            f"link set {layout.name} master {layout.kind}",
            f"route add {layout.everything} via {layout.router} dev {layout.kind}",
        )

    def _create(self, kind: Path, text: str) -> None:
        """Have kind make the containers and Kubernetes in them."""
        layout = self.layout
        layout.registries.mkdir(exist_ok=True)
        layout.plane.mkdir(exist_ok=True)
        settings, kubeconfig = layout.home / "kind.json", layout.home / "kind.kubeconfig"
        settings.write_text(text)
        command = [*processes.bond(True), str(kind), "create", "cluster", f"--config={settings}"]
        command += [f"--name={layout.kind}", f"--kubeconfig={kubeconfig}"]
        image = os.environ.get(IMAGE, "")
        command += [f"--image={image}"] if image else []
        environment = processes.without_proxies(os.environ) | {
            "KIND_EXPERIMENTAL_PROVIDER": "docker",
            "KIND_EXPERIMENTAL_DOCKER_NETWORK": layout.kind,
        }
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=CREATE_S, check=False, cwd=layout.home
        )
        if done.returncode:
            hint = f"Next, where no registry can be reached: {IMAGE}=$(python -m robot_offload_lab.cluster.kind_image)"
            raise ClusterError(f"kind made no cluster; it said:\n{done.stderr.strip()[-4000:]}\n{hint}")
        self.plane.adopt(kubeconfig)

    def _know_nodes(self) -> None:
        """Set up the nodes, and the routes between their pods, the router and them."""
        layout, found = self.layout, {}
        for each in self.kubectl("").json("get", "nodes")["items"]:
            name = str(each["metadata"]["name"])
            node = KindNode(name, layout, self.plane)
            node.connect()
            netns.ip(f"route replace {each['spec']['podCIDR']} via {node.address}", netns=layout.netns("net"))
            found[name] = node
        del found[layout.control_plane]
        self.nodes = found
