"""The control plane of a cluster with nodes: in a network namespace of its own, with certificates, all controllers."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from robot_offload_lab.cluster import netns
from robot_offload_lab.cluster.certificates import Authority
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.layout import Layout
from robot_offload_lab.cluster.programs import Programs

ETCD_PORT, API_PORT = 2379, 6443


class NodesPlane(ControlPlane):
    """etcd, kube-apiserver, kube-controller-manager and kube-scheduler for real nodes.

    Attributes:
        authority: Issues what the nodes need; None when another process has started this cluster.
        certificates: Directory of all certificates.
    """

    def __init__(self, layout: Layout, programs: Programs, *, fast_failure: bool) -> None:
        super().__init__(layout.plane, programs)
        self.host = layout.api
        self.favoured = True
        self.within = netns.into(layout.netns("plane"))
        self.certificates = layout.plane / "pki"
        self.ca_file = self.certificates / "ca.crt"
        self.authority: Authority | None = None
        self._layout = layout
        self._fast_failure = fast_failure
        self._die_with_us = True

    def start(self, definitions: Sequence[Path] = (), *, die_with_us: bool = True) -> Self:
        """Start everything, the scheduler last."""
        self._die_with_us = die_with_us
        super().start(definitions, die_with_us=die_with_us)
        settings = {"kubeconfig": str(self._user_file("scheduler")), "leader-elect": "false", "secure-port": "0"}
        self._spawn("kube-scheduler", settings, die_with_us=die_with_us)
        return self

    def stop_api(self) -> None:
        """Kill the API server; everything else stays."""
        server = self._servers.pop("kube-apiserver")
        server.kill()
        server.wait()

    def start_api(self) -> None:
        """Start the API server again, with all its data."""
        self._spawn("kube-apiserver", self._api_settings(API_PORT, ETCD_PORT), die_with_us=self._die_with_us)
        self._wait("the API server to be ready", lambda: self.get("/readyz") == "ok")

    def node_certificates(self, name: str, address: str) -> None:
        """Issue the certificates that the kubelet of a node needs."""
        assert self.authority is not None
        self.authority.server(f"{name}-server", [address], [name])
        self.authority.client(f"{name}-client", f"system:node:{name}", ["system:nodes"])

    def node_is_ready(self, name: str) -> bool:
        """Return whether Kubernetes considers a node ready; a failure is noticed after a while."""
        node = json.loads(self.get(f"/api/v1/nodes/{name}"))
        return any(each["type"] == "Ready" and each["status"] == "True" for each in node["status"]["conditions"])

    def node_reported_after(self, name: str, moment: dt.datetime) -> bool:
        """Return whether the kubelet of a node has reported since a moment."""
        lease = json.loads(self.get(f"/apis/coordination.k8s.io/v1/namespaces/kube-node-lease/leases/{name}"))
        return dt.datetime.fromisoformat(lease["spec"]["renewTime"]) > moment

    def kubeconfig_with(self, certificate: str, path: Path) -> Path:
        """Write a kubeconfig for the user of a certificate."""
        name = "robot-offload-test"
        user = {
            "client-certificate": str(self.certificates / f"{certificate}.crt"),
            "client-key": str(self.certificates / f"{certificate}.key"),
        }
        server = {"server": f"https://{self.host}:{API_PORT}", "certificate-authority": str(self.ca_file)}
        config = {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": name, "cluster": server}],
            "users": [{"name": name, "user": user}],
            "contexts": [{"name": name, "context": {"cluster": name, "user": name}}],
            "current-context": name,
        }
        path.write_text(json.dumps(config, indent=1))
        path.chmod(0o600)
        return path

    def _user_file(self, word: str) -> Path:
        return self.directory / f"{word}.kubeconfig"

    def _ports(self) -> list[int]:
        return [ETCD_PORT, API_PORT]  # no other program is in this network namespace

    def _write_secrets(self) -> None:
        super()._write_secrets()
        self.authority = Authority(self.certificates, dt.datetime.now(dt.UTC))
        names = ["localhost", "kubernetes", "kubernetes.default", "kubernetes.default.svc"]
        self.authority.server("apiserver", ["127.0.0.1", self.host, self._layout.first_service], names)
        self.authority.client("apiserver-to-kubelet", "kube-apiserver-kubelet-client", ["system:masters"])
        for word in ("controller-manager", "scheduler", "proxy"):
            self.authority.client(word, f"system:kube-{word}")
            self.kubeconfig_with(word, self._user_file(word))

    def _api_settings(self, port: int, etcd_port: int) -> dict[str, str]:
        settings: dict[str, Any] = super()._api_settings(port, etcd_port)
        del settings["endpoint-reconciler-type"]
        settings |= {
            "bind-address": "0.0.0.0",  # in its own network namespace
            "service-cluster-ip-range": self._layout.services,
            "authorization-mode": "Node,RBAC",
            "enable-admission-plugins": "NodeRestriction,OwnerReferencesPermissionEnforcement",
            "client-ca-file": str(self.ca_file),
            "tls-cert-file": f"{self.certificates}/apiserver.crt",
            "tls-private-key-file": f"{self.certificates}/apiserver.key",
            "kubelet-certificate-authority": str(self.ca_file),
            "kubelet-client-certificate": f"{self.certificates}/apiserver-to-kubelet.crt",
            "kubelet-client-key": f"{self.certificates}/apiserver-to-kubelet.key",
            "kubelet-preferred-address-types": "InternalIP",
        }
        if self._fast_failure:
            settings["default-not-ready-toleration-seconds"] = "3"
            settings["default-unreachable-toleration-seconds"] = "3"
        return settings

    def _controller_settings(self) -> dict[str, str]:
        settings = super()._controller_settings()
        del settings["controllers"]  # all of them
        settings |= {
            "kubeconfig": str(self._user_file("controller-manager")),
            "use-service-account-credentials": "true",
        }
        if self._fast_failure:
            settings |= {"node-monitor-grace-period": "8s", "node-monitor-period": "1s"}
        return settings
