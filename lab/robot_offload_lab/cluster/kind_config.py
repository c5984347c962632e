"""The configuration file of a cluster of kind."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from robot_offload_lab.cluster import cgroups
from robot_offload_lab.cluster.kind_layout import KindLayout

REGISTRIES = "/etc/containerd/certs.d"
"""Where containerd looks for settings of a registry."""


def configuration(layout: KindLayout, nodes: int, *, fast_failure: bool) -> str:
    """Return the text of the file, in JSON, which is also YAML.

    Args:
        layout: Names and addresses.
        nodes: How many run pods, beside the control plane.
        fast_failure: A dead node is noticed after 9 s and its pods are moved 3 s later, not after 50 s and 5 min.
    """
    mounts = [{"hostPath": str(layout.registries), "containerPath": REGISTRIES}]
    roles = ["control-plane", *["worker"] * nodes]
    patches = [_kubelet(fast_failure=fast_failure), *([_control_plane()] if fast_failure else [])]
    registry = f'[plugins."io.containerd.grpc.v1.cri".registry]\nconfig_path = "{REGISTRIES}"\n'
    wanted = {
        "kind": "Cluster",
        "apiVersion": "kind.x-k8s.io/v1alpha4",
        "name": layout.kind,
        "networking": {
            "ipFamily": "ipv4",
            "podSubnet": layout.pods,
            "serviceSubnet": layout.services,
            "kubeProxyMode": "nftables",
        },
        "nodes": [{"role": role, "extraMounts": mounts} for role in roles],
        "kubeadmConfigPatches": [json.dumps(each) for each in patches],
        "containerdConfigPatches": [registry],
    }
    return json.dumps(wanted, indent=1)


def _kubelet(*, fast_failure: bool) -> Mapping[str, Any]:
    """Return settings like those of our own nodes' kubelets, as far as stories depend on them."""
    settings: dict[str, Any] = {
        "kind": "KubeletConfiguration",
        "maxPods": 60,
    }
    if fast_failure:
        settings |= {"nodeStatusUpdateFrequency": "2s", "nodeLeaseDurationSeconds": 8}
    if not cgroups.unified():
        settings["failCgroupV1"] = False
    return settings


def _control_plane() -> Mapping[str, Any]:
    # In the form of kubeadm v1beta3, without a version: kind translates it for a newer one.
    tolerations = ("default-not-ready-toleration-seconds", "default-unreachable-toleration-seconds")
    return {
        "kind": "ClusterConfiguration",
        "apiServer": {"extraArgs": dict.fromkeys(tolerations, "3")},
        "controllerManager": {"extraArgs": {"node-monitor-grace-period": "8s", "node-monitor-period": "1s"}},
    }
