"""What a kubelet would report: here no Pod ever starts, and some tests want to see what follows when it has."""

from __future__ import annotations

import json
from typing import Any

from tests.cluster.control_plane import ControlPlane

LONG_AGO = "2026-01-01T00:00:00Z"  # ready for longer than any minReadySeconds


def report_ready(plane: ControlPlane, namespace: str, *, ready: bool = True) -> list[str]:
    """Report every Pod of a namespace as running and ready, or as running and not ready.

    Returns:
        The names of those Pods.
    """
    pods = json.loads(plane.get(f"/api/v1/namespaces/{namespace}/pods"))["items"]
    for pod in pods:
        path = f"/api/v1/namespaces/{namespace}/pods/{pod['metadata']['name']}/status"
        plane.request("PATCH", path, {"status": _status(pod, ready=ready)}, "application/merge-patch+json")
    return [pod["metadata"]["name"] for pod in pods]


def _status(pod: dict[str, Any], *, ready: bool) -> dict[str, Any]:
    kinds = ("PodScheduled", "Initialized", "ContainersReady", "Ready")
    values = (True, True, ready, ready)
    return {
        "phase": "Running",
        "podIP": "10.88.0.1",
        "podIPs": [{"ip": "10.88.0.1"}],
        "startTime": LONG_AGO,
        "conditions": [
            {"type": kind, "status": str(value), "lastTransitionTime": LONG_AGO}
            for kind, value in zip(kinds, values, strict=True)
        ],
        "containerStatuses": [_container(each, ready=ready) for each in pod["spec"]["containers"]],
    }


def _container(container: dict[str, Any], *, ready: bool) -> dict[str, Any]:
    return {
        "name": container["name"],
        "image": container["image"],
        "imageID": "",
        "ready": ready,
        "started": True,
        "restartCount": 0,
        "state": {"running": {"startedAt": LONG_AGO}},
    }
