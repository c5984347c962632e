"""Objects with which the tests of the test cluster fill it."""

from __future__ import annotations

from typing import Any

from robot_offload_lab.cluster.system_images import TESTER

PORT = 7000


def echo_pod(name: str, node: str, *, app: str = "echo") -> dict[str, Any]:
    """A pod that answers over TCP and UDP with its name and the address that asked."""
    container = {
        "name": "tester",
        "image": TESTER,
        "imagePullPolicy": "Never",
        "args": ["serve", str(PORT)],
        "readinessProbe": {"tcpSocket": {"port": PORT}, "periodSeconds": 1},
    }
    spec = {"nodeName": node, "terminationGracePeriodSeconds": 1, "containers": [container]}
    return {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": name, "labels": {"app": app}}, "spec": spec}


def echo_service(name: str = "echo", *, app: str = "echo", **spec: str) -> dict[str, Any]:
    """The Service of the echo pods, TCP and UDP."""
    ports = [{"name": each.lower(), "protocol": each, "port": PORT} for each in ("TCP", "UDP")]
    whole = {"selector": {"app": app}, "ports": ports, **spec}
    return {"apiVersion": "v1", "kind": "Service", "metadata": {"name": name}, "spec": whole}


def policy(name: str, app: str, **spec: Any) -> dict[str, Any]:
    """A NetworkPolicy for the pods of an app."""
    whole = {"podSelector": {"matchLabels": {"app": app}}, **spec}
    kind = {"apiVersion": "networking.k8s.io/v1", "kind": "NetworkPolicy"}
    return {**kind, "metadata": {"name": name}, "spec": whole}
