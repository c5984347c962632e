"""The files of a node: the configuration of containerd, its network plugin, kubelet and kube-proxy."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_offload_lab.cluster.layout import Layout
from robot_offload_lab.cluster.system_images import PAUSE


@dataclass(frozen=True, slots=True)
class NodeFiles:
    """One node: its names, its directories and the contents of its files."""

    layout: Layout
    index: int
    programs: Path
    certificates: Path
    fast_failure: bool

    @property
    def name(self) -> str:
        """Name of the node, in Kubernetes and in network namespaces."""
        return f"node{self.index}"

    @property
    def home(self) -> Path:
        """All its files except images."""
        return self.layout.home / self.name

    @property
    def kept(self) -> Path:
        """Its images, which stay for the next cluster."""
        return self.layout.kept / self.name

    @property
    def socket(self) -> Path:
        """Where containerd listens."""
        return self.home / "run" / "containerd.sock"

    @property
    def cgroup(self) -> str:
        """Control group of all its pods."""
        return f"{self.layout.name}-{self.name}"

    def write(self) -> None:
        """Write all of them."""
        self.home.mkdir(parents=True, exist_ok=True)
        (self.home / "cni").mkdir(exist_ok=True)
        (self.home / "containerd.toml").write_text(self._containerd())
        (self.home / "cni" / "10-pods.conflist").write_text(json.dumps(self._network(), indent=1))
        (self.home / "kubelet.json").write_text(json.dumps(self._kubelet(), indent=1))
        (self.home / "kube-proxy.json").write_text(json.dumps(self._proxy(), indent=1))
        (self.home / "resolv.conf").write_text("")  # no upstream name server: no query leaves by accident
        (self.home / "init.sh").write_text(self._init())

    def _containerd(self) -> str:
        # restrict_oom_score_adj: without CAP_SYS_RESOURCE every sandbox would die at its start.
        return f"""version = 2
root = "{self.kept}"
state = "{self.home}/run/containerd"
oom_score = 0
[grpc]
  address = "{self.socket}"
[plugins."io.containerd.grpc.v1.cri"]
  sandbox_image = "{PAUSE}"
  restrict_oom_score_adj = true
  disable_apparmor = true
  [plugins."io.containerd.grpc.v1.cri".registry]
    config_path = "{self.layout.registries}"
  [plugins."io.containerd.grpc.v1.cri".cni]
    bin_dir = "/usr/lib/cni"
    conf_dir = "{self.home}/cni"
  [plugins."io.containerd.grpc.v1.cri".containerd]
    snapshotter = "overlayfs"
    default_runtime_name = "runc"
    [plugins."io.containerd.grpc.v1.cri".containerd.runtimes.runc]
      runtime_type = "io.containerd.runc.v2"
      [plugins."io.containerd.grpc.v1.cri".containerd.runtimes.runc.options]
        SystemdCgroup = false
[plugins."io.containerd.internal.v1.opt"]
  path = "{self.home}/opt"
"""

    def _network(self) -> Mapping[str, Any]:
        addresses = {
            "type": "host-local",
            "dataDir": f"{self.home}/ipam",
            "ranges": [[{"subnet": self.layout.node_pods(self.index)}]],
            "routes": [{"dst": "0.0.0.0/0"}],
        }
        bridge = {"type": "bridge", "bridge": "cni0", "isGateway": True, "ipMasq": False, "hairpinMode": True}
        ports = {"type": "portmap", "capabilities": {"portMappings": True}}
        return {"cniVersion": "0.4.0", "name": "pods", "plugins": [{**bridge, "ipam": addresses}, ports]}

    def _kubelet(self) -> Mapping[str, Any]:
        pki = self.certificates
        return {
            "apiVersion": "kubelet.config.k8s.io/v1beta1",
            "kind": "KubeletConfiguration",
            "containerRuntimeEndpoint": f"unix://{self.socket}",
            "failCgroupV1": False,
            "cgroupDriver": "cgroupfs",
            "cgroupRoot": f"/{self.cgroup}",  # keeps several kubelets apart
            "cgroupsPerQOS": True,
            "enforceNodeAllocatable": ["pods"],
            "failSwapOn": False,
            "oomScoreAdj": 0,
            "maxOpenFiles": 20000,
            "maxPods": 60,
            "authentication": {
                "anonymous": {"enabled": False},
                "webhook": {"enabled": True},
                "x509": {"clientCAFile": f"{pki}/ca.crt"},
            },
            "authorization": {"mode": "Webhook"},
            "tlsCertFile": f"{pki}/{self.name}-server.crt",
            "tlsPrivateKeyFile": f"{pki}/{self.name}-server.key",
            "clusterDomain": "cluster.local",
            "clusterDNS": [self.layout.names_service],
            "resolvConf": f"{self.home}/resolv.conf",
            "evictionHard": {"memory.available": "200Mi", "nodefs.available": "2%", "imagefs.available": "2%"},
            "imageGCHighThresholdPercent": 100,  # a removed image cannot be pulled again
            # How it reads ConfigMaps is the default, so that figures of this cluster hold elsewhere.
            "nodeStatusUpdateFrequency": "2s" if self.fast_failure else "10s",
            "nodeLeaseDurationSeconds": 8 if self.fast_failure else 40,
            "volumePluginDir": f"{self.home}/plugins",
        }

    def _proxy(self) -> Mapping[str, Any]:
        # The limits of connection tracking can only be set in the machine's first network namespace.
        tracking = {"maxPerCore": 0, "min": 0, "tcpEstablishedTimeout": "0s", "tcpCloseWaitTimeout": "0s"}
        return {
            "apiVersion": "kubeproxy.config.k8s.io/v1alpha1",
            "kind": "KubeProxyConfiguration",
            "clientConnection": {"kubeconfig": f"{self.layout.plane}/proxy.kubeconfig"},
            "hostnameOverride": self.name,
            "mode": "nftables",
            "clusterCIDR": self.layout.pods,
            "conntrack": tracking,
            "oomScoreAdj": 0,
            "healthzBindAddress": "127.0.0.1:10256",
            "metricsBindAddress": "127.0.0.1:10249",
        }

    def _init(self) -> str:
        """Return the first process of the node. bash reaps the shims whose parent is gone.

        The fixed folders of programs (/run, /var/lib, /var/log) are the node's own: two kubelets that share
        /var/log/pods delete each other's logs. `/` is shared for pods that propagate mounts. A kubelet ends when
        containerd listens but still recovers from a power cut: it is started again, as by a service manager.
        """
        home, log = self.home, f"{self.home}/log"
        return f"""set -u
hostname {self.name}
mount --make-rshared /
mkdir -p {log} {home}/lib {home}/run
mount -t tmpfs tmpfs /run
mkdir -p /run/netns /run/lock
mount --bind {log} /var/log
mount --bind {home}/lib /var/lib
ulimit -n "$(ulimit -Hn)"
containerd --config={home}/containerd.toml > {log}/containerd.log 2>&1 & runtime=$!
until [ -e {home}/images-ready ]; do sleep 0.05; [ -e /proc/$runtime ] || exit 1; done
while :; do
  {self.programs}/kubelet --config={home}/kubelet.json --kubeconfig={home}/kubelet.kubeconfig \\
    --hostname-override={self.name} --node-ip={self.layout.node(self.index)} --root-dir=/var/lib/kubelet \\
    --cert-dir={home}/kubelet-pki --v=2
  sleep 0.5
done > {log}/kubelet.log 2>&1 &
{self.programs}/kube-proxy --config={home}/kube-proxy.json --v=1 > {log}/kube-proxy.log 2>&1 &
while :; do wait -n; sleep 0.2; done
"""
