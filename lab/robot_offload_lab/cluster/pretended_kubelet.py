"""Reports in place of a kubelet: here no Pod ever starts, but some tests need what follows a start."""

from __future__ import annotations

import json
from typing import Any
from urllib.error import HTTPError

from robot_offload_lab.cluster.control_plane import ControlPlane

LONG_AGO = "2026-01-01T00:00:00Z"  # ready for longer than any minReadySeconds


def report_ready(plane: ControlPlane, namespace: str, *, ready: bool = True) -> list[str]:
    """Report every Pod of a namespace as running and ready, or as running and not ready.

    Returns:
        The names of those Pods, without those that have gone meanwhile.
    """
    pods = json.loads(plane.get(f"/api/v1/namespaces/{namespace}/pods"))["items"]
    return [pod["metadata"]["name"] for pod in pods if _reported(plane, namespace, pod, _status(pod, ready=ready))]


def report_ended(
    plane: ControlPlane, namespace: str, job: str, messages: dict[str, str], failing: str = ""
) -> list[str]:
    """Report the Pods of a Job as ended.

    Args:
        plane: the control plane.
        namespace: of the Job.
        job: its name.
        messages: termination messages by container; others left none.
        failing: the container that failed, so that later ones have not run; empty: all succeeded.

    Returns:
        The names of those Pods, without those that have gone meanwhile.
    """
    path = f"/api/v1/namespaces/{namespace}/pods"
    pods = json.loads(plane.get(f"{path}?labelSelector=batch.kubernetes.io/job-name={job}"))["items"]
    return [
        pod["metadata"]["name"]
        for pod in pods
        if _reported(plane, namespace, pod, _ended_status(pod, messages, failing))
    ]


def _reported(plane: ControlPlane, namespace: str, pod: dict[str, Any], status: dict[str, Any]) -> bool:
    """Write the status of a Pod; return whether the Pod is still there."""
    path = f"/api/v1/namespaces/{namespace}/pods/{pod['metadata']['name']}/status"
    try:
        plane.request("PATCH", path, {"status": status}, "application/merge-patch+json")
    except HTTPError as error:
        with error:  # it holds the connection
            if error.code != 404:
                raise
            return False
    return True


def _ended_status(pod: dict[str, Any], messages: dict[str, str], failing: str) -> dict[str, Any]:
    found: dict[str, list[dict[str, Any]]] = {}
    over = False
    for field, containers in (("initContainerStatuses", "initContainers"), ("containerStatuses", "containers")):
        found[field] = []
        for container in pod["spec"].get(containers, ()):
            name = container["name"]
            ended = {
                "exitCode": int(name == failing),
                "reason": "Error" if name == failing else "Completed",
                "message": messages.get(name, ""),
                "startedAt": LONG_AGO,
                "finishedAt": LONG_AGO,
            }
            state = {"waiting": {"reason": "PodInitializing"}} if over else {"terminated": ended}
            found[field].append({**_container(container, ready=False), "started": False, "state": state})
            over = over or name == failing
    return {"phase": "Failed" if failing else "Succeeded", "startTime": LONG_AGO, **found}


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
