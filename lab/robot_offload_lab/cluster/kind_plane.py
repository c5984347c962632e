"""The control plane of a cluster made by kind: how to reach it, and to switch its API server off and on."""

from __future__ import annotations

import base64
import json
import time
from pathlib import Path
from typing import Self

from robot_offload_lab.cluster import kind_docker
from robot_offload_lab.cluster.commands import Kubectl
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.kind_layout import KindLayout
from robot_offload_lab.cluster.nodes_plane import API_PORT, NodesPlane
from robot_offload_lab.cluster.programs import Programs

ADMINISTRATOR = "rofkind-administrator"
PATIENCE = 120.0  # seconds for what takes some
_MANIFEST = "/etc/kubernetes/manifests/kube-apiserver.yaml"
_ASIDE = "/etc/kubernetes/kube-apiserver.yaml"


class KindPlane(NodesPlane):
    """A control plane in a container; nothing of it is started here."""

    def __init__(self, layout: KindLayout, programs: Programs) -> None:
        super().__init__(layout, programs, fast_failure=False)
        self._container = layout.control_plane
        self._network = layout.kind

    def adopt(self, written_by_kind: Path) -> Self:
        """Take over the cluster of a kubeconfig, with a token, which must not be combined with a certificate.

        Use the address of the container: kind's own is Docker's proxy, which answers even without an API server.
        """
        kubectl = Kubectl(self.programs.path("kubectl"), written_by_kind, "kube-system")
        cluster = json.loads(kubectl("config", "view", "--raw", "--output=json"))["clusters"][0]["cluster"]
        self.certificates.mkdir(parents=True, exist_ok=True)
        self.ca_file.write_bytes(base64.b64decode(cluster["certificate-authority-data"]))
        self.url = f"https://{kind_docker.address(self._container, self._network)}:{API_PORT}"
        kubectl("create", "serviceaccount", ADMINISTRATOR)
        whose = f"--serviceaccount=kube-system:{ADMINISTRATOR}"
        kubectl("create", "clusterrolebinding", ADMINISTRATOR, "--clusterrole=cluster-admin", whose)
        self.token = kubectl("create", "token", ADMINISTRATOR, "--duration=48h").strip()
        self._write_kubeconfig(self.kubeconfig, self.token, "default")
        return self

    def stop_api(self) -> None:
        """Take its manifest away, so that its kubelet does not start it again, and kill it."""
        kind_docker.inside(self._container, "mv", _MANIFEST, _ASIDE)
        deadline = time.monotonic() + PATIENCE
        # Until the kubelet has noticed that the manifest is gone it may start another one.
        quiet_since = time.monotonic()
        while time.monotonic() < quiet_since + 1.0:
            if kind_docker.inside(self._container, "sh", "-c", "pkill -KILL -x kube-apiserver && echo one || true"):
                quiet_since = time.monotonic()
            if time.monotonic() > deadline:
                raise ClusterError(f"The API server comes back after {PATIENCE:.0f} s without its manifest")
            time.sleep(0.1)

    def start_api(self) -> None:
        """Put its manifest back and wait until it answers."""
        kind_docker.inside(self._container, "mv", _ASIDE, _MANIFEST)
        self._wait("the API server to be ready", lambda: self.get("/readyz") == "ok")
