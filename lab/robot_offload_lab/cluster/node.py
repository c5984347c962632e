"""A node: containerd, kubelet and kube-proxy in namespaces of their own. It can lose its power and get it back."""

from __future__ import annotations

import datetime as dt
import json
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.error import HTTPError

from robot_offload_lab.cluster import cgroups, netns, network, oci, policies, processes, system_images
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import MOST_NODES
from robot_offload_lab.cluster.node_files import NodeFiles
from robot_offload_lab.cluster.nodes_plane import NodesPlane

PATIENCE = 180.0  # seconds; a node is ready after five, but the machine may be busy with a build
_MOUNTS = ("--mount", "--propagation", "private")


class ClusterNode:
    """One node of a cluster.

    Attributes:
        name: In Kubernetes.
        address: In the cluster's network.
    """

    def __init__(
        self, files: NodeFiles, plane: NodesPlane, system_images: Sequence[Path], *, die_with_us: bool
    ) -> None:
        self.name = files.name
        self.address = files.layout.node(files.index)
        self._files = files
        self._plane = plane
        self._system_images = system_images
        self._die_with_us = die_with_us
        self._process: subprocess.Popen[bytes] | None = None
        self._since = dt.datetime.now(dt.UTC)

    @property
    def netns(self) -> str:
        """Its network namespace."""
        return self._files.layout.netns(self.name)

    def install(self) -> None:
        """Write its files and issue its certificates, once for a machine."""
        shutil.rmtree(self._files.home, ignore_errors=True)
        self._files.write()
        self._plane.node_certificates(self.name, self.address)
        self._plane.kubeconfig_with(f"{self.name}-client", self._files.home / "kubelet.kubeconfig")

    def power_on(self) -> None:
        """Start the node; `wait_ready` waits until it works. For the main thread only: a node ends with its thread."""
        self.boot()
        self.start_kubelet()

    def boot(self) -> None:
        """Start what it can by itself; several nodes may do so at the same time."""
        self._since = dt.datetime.now(dt.UTC)
        # A leftover socket would look as if containerd answered.
        shutil.rmtree(self._files.home / "run", ignore_errors=True)
        (self._files.home / "images-ready").unlink(missing_ok=True)
        self._plug_in()
        cgroups.make(self._files.cgroup)
        isolation = [*_MOUNTS, "--pid", "--fork", "--kill-child", "--mount-proc", "--uts"]
        home = self._files.home
        command = [*netns.into(self.netns), "unshare", *isolation, f"--wd={home}/", "bash", str(home / "init.sh")]
        self._process = processes.spawn(command, home / "init.log", die_with_us=self._die_with_us, favoured=True)

    def start_kubelet(self) -> None:
        """Start what needs images, once the node has them."""
        self._wait(f"containerd of {self.name}", self._containerd_answers)
        known = self._files.home / "booted-before"
        # Images of the last cluster stay, its containers do not.
        if not known.exists() and (names := self._ctr("containers", "ls", "-q").split()):
            self._ctr("containers", "rm", *names)
        known.touch()
        self.import_images(self._system_images)
        (self._files.home / "images-ready").touch()

    def power_off(self) -> None:
        """Cut the power: everything on the node ends at once, without notice."""
        # Its first process ends with `unshare`, and everything else with its first process.
        netns.signal_all(processes.running(self._files.home))
        self.reap()
        network.unplug(self._files.layout, self.name)
        netns.remove(self.netns)
        cgroups.remove(self._files.cgroup)

    def reap(self) -> None:
        """Wait for its first process, which has been killed."""
        if self._process is not None:
            self._process.wait()
            self._process = None

    def wait_ready(self) -> None:
        """Wait until it has reported since it was switched on or healed, and Kubernetes considers it ready."""
        reported = self._plane.node_reported_after
        self._wait(f"{self.name} to be ready", lambda: reported(self.name, self._since) and self.is_ready())

    def is_ready(self) -> bool:
        """Return whether Kubernetes considers it ready; a failure is noticed after a while."""
        return self._plane.node_is_ready(self.name)

    def has_power(self) -> bool:
        """Return whether it is switched on."""
        return netns.exists(self.netns)

    def enforces_policies(self) -> bool:
        """Return whether NetworkPolicies hold for its pods."""
        return policies.in_force(self.netns)

    def partition(self) -> None:
        """Cut it off the network; it runs on."""
        network.unplug(self._files.layout, self.name)

    def heal(self) -> None:
        """Put it back on the network."""
        self._since = dt.datetime.now(dt.UTC)
        network.replug(self._files.layout, self.name)

    def import_images(self, archives: Sequence[Path]) -> None:
        """Import OCI archives unless it has them; remove images of ours without an archive, to save disk space."""
        self._files.kept.mkdir(parents=True, exist_ok=True)
        stamp = self._files.kept / "imported.json"
        imported = json.loads(stamp.read_text()) if stamp.exists() else {}
        for archive in archives:
            status = archive.stat()
            version = [status.st_mtime_ns, status.st_size]
            if imported.get(str(archive)) != version:
                self._ctr("images", "import", str(archive))
                imported[str(archive)] = version
                self._forget_images(imported)
                stamp.write_text(json.dumps(imported))

    def _forget_images(self, imported: dict[str, list[int]]) -> None:
        for path in [path for path in imported if not Path(path).exists()]:
            del imported[path]
        known = {name for path in imported for name in oci.names(Path(path))}
        there = self._ctr("images", "ls", "-q").split()
        if old := [name for name in there if name.startswith(system_images.OURS) and name not in known]:
            self._ctr("images", "rm", *old)

    def log(self, program: str) -> str:
        """Return the last log lines of containerd, kubelet or kube-proxy."""
        path = self._files.home / "log" / f"{program}.log"
        return path.read_text(errors="replace")[-3000:] if path.exists() else ""

    def _plug_in(self) -> None:
        layout = self._files.layout
        netns.make(self.netns, forwards=True)
        network.plug(layout, self.netns, self.address, self.name)
        # Traffic between two pods of a node over its bridge is filtered and translated like all other.
        netns.run("sysctl", "-q", "-w", "net.bridge.bridge-nf-call-iptables=1", netns=self.netns)
        others = [each for each in range(1, MOST_NODES + 1) if each != self._files.index]
        routes = [f"route add {layout.node_pods(each)} via {layout.node(each)}" for each in others]
        netns.ip(*routes, netns=self.netns)

    def _containerd_answers(self) -> bool:
        try:
            self._ctr("version")
        except ClusterError:
            return False
        return True

    def _ctr(self, *arguments: str) -> str:
        return netns.run("ctr", "--address", str(self._files.socket), "--namespace", "k8s.io", *arguments)

    def _wait(self, what: str, happened: Callable[[], bool]) -> None:
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
            ended = self._process is not None and self._process.poll() is not None
            if ended or time.monotonic() > deadline:
                logs = "\n".join(f"{each}: {self.log(each)}" for each in ("containerd", "kubelet", "kube-proxy"))
                said = (self._files.home / "init.log").read_text(errors="replace")[-1000:]
                why = "it ended" if ended else f"after {PATIENCE:.0f} s: {trouble}"
                raise ClusterError(f"Waited for {what}; {why}\n{said}\n{logs}")
            time.sleep(0.05)
