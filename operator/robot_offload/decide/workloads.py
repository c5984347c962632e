"""Whether Deployments, StatefulSets and their pods run as they should, and if not, why."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide.conditions import discovery_ready
from robot_offload.decide.ownership import Key
from robot_offload.decide.verdicts import Verdict, gravest, no, yes
from robot_offload.kube.kinds import DEPLOYMENT, JOB, STATEFUL_SET, kind_of
from robot_offload.kube.port import Manifest
from robot_offload.objects.names import discovery_child

_WORKLOADS: Final = (DEPLOYMENT, STATEFUL_SET)
_IMAGE_REASONS: Final = ("ImagePullBackOff", "ErrImagePull", "InvalidImageName", "ErrImageNeverPull")


def workload(manifest: Manifest, pods: Iterable[Manifest] = (), refusal: str = "") -> Verdict:
    """Return whether a Deployment or StatefulSet has as many ready pods of its present form as it should.

    Args:
        manifest: the workload.
        pods: of the workload, as far as known.
        refusal: why the API server refuses its pods, in its own words; empty: the workload's status may contain it.
    """
    name = manifest["metadata"]["name"]
    wanted = int((manifest.get("spec") or {}).get("replicas", 1))
    status: Mapping[str, Any] = manifest.get("status") or {}
    if wanted == 0:
        return yes("ScaledDown", f"{name} has no pods on purpose")
    observed = int(status.get("observedGeneration") or 0) >= int(manifest["metadata"].get("generation") or 0)
    ready = int(status.get("readyReplicas") or 0)
    updated = int(status.get("updatedReplicas") or 0)
    if observed and ready >= wanted and updated >= wanted:
        return yes("Available", f"{name} is ready")
    return (
        pod_trouble(name, pods)
        or _refused(name, refusal or _refusal_in(status))
        or no("PodsNotReady", f"{name}: {ready} of {wanted} pods are ready; look at its pods")
    )


def settled(manifest: Manifest) -> bool:
    """Return whether a workload's pods have been ready for its `minReadySeconds`."""
    status: Mapping[str, Any] = manifest.get("status") or {}
    available = int(status.get("availableReplicas", status.get("readyReplicas")) or 0)
    return workload(manifest).holds and available >= int((manifest.get("spec") or {}).get("replicas", 1))


def conditions(
    offload: RobotOffload,
    live: Mapping[Key, Manifest],
    pods: Iterable[Manifest],
    wanted: bool,
    why: Verdict,
    refusals: Mapping[Key, str],
) -> dict[str, Verdict]:
    """Return the conditions DiscoveryReady and WorkloadsAvailable.

    Args:
        offload: owner of the workloads.
        live: its children.
        pods: of workloads that are not as they should be; those of others may be omitted.
        wanted: whether nodes should have pods.
        why: the reason if they should not.
        refusals: why the API server refuses pods, by workload.
    """
    known = list(pods)
    judged = {
        key: workload(child, pods_of(child, known), refusals.get(key, ""))
        for key, child in live.items()
        if key[0] in _WORKLOADS
    }
    servers = transport.discovery_servers(offload.spec)
    names = [discovery_child(offload.metadata.name, server) for server in range(servers)]
    fine = yes("Available", "All workloads are available") if wanted else yes(why.reason, why.message)
    return {
        "DiscoveryReady": discovery_ready(
            servers, [judged[key] for name in names if (key := (STATEFUL_SET, name)) in judged]
        ),
        "WorkloadsAvailable": together([verdict for key, verdict in judged.items() if key[0] == DEPLOYMENT], fine),
    }


def pods_of(manifest: Manifest, pods: Iterable[Manifest]) -> list[Manifest]:
    """Return the pods that a workload selects."""
    labels = ((manifest.get("spec") or {}).get("selector") or {}).get("matchLabels") or {}
    return [
        pod
        for pod in pods
        if labels and labels.items() <= (pod["metadata"].get("labels") or {}).items() and not _ended(pod)
    ]


def together(verdicts: Iterable[Verdict], fine: Verdict) -> Verdict:
    """Combine verdicts: the gravest that does not hold gives the reason, and the message contains all such."""
    bad = [verdict for verdict in verdicts if not verdict.holds]
    worst = gravest(bad)
    return no(worst.reason, "; ".join(verdict.message for verdict in bad)) if worst is not None else fine


def pod_trouble(name: str, pods: Iterable[Manifest]) -> Verdict | None:
    """Return what keeps pods from running, for the workload of that name; None: their statuses show nothing."""
    for pod in pods:
        status = pod.get("status") or {}
        for condition in status.get("conditions") or ():
            if condition.get("type") == "PodScheduled" and condition.get("status") == "False":
                return no(
                    "Unschedulable", f"{name}: no node of the cluster fits its pod: {condition.get('message', '')}"
                )
        for container in [*(status.get("initContainerStatuses") or ()), *(status.get("containerStatuses") or ())]:
            trouble = _container_trouble(name, container)
            if trouble:
                return trouble
    return None


def _container_trouble(name: str, container: Mapping[str, Any]) -> Verdict | None:
    waiting = (container.get("state") or {}).get("waiting") or {}
    reason, which = waiting.get("reason", ""), container.get("name", "")
    if reason in _IMAGE_REASONS:
        return no("ImagePullFailing", f"{name}: the image {container.get('image')} cannot be pulled ({reason})")
    if reason == "CrashLoopBackOff":
        ended = (container.get("lastState") or {}).get("terminated") or {}
        return no(
            "CrashLoop",
            f"{name}: container {which} ends again and again with code {ended.get('exitCode', '?')}; look at its log",
        )
    if reason in ("CreateContainerConfigError", "CreateContainerError", "RunContainerError"):
        return no(reason, f"{name}: container {which} cannot be started: {waiting.get('message', '')}")
    return None


def _refused(name: str, words: str) -> Verdict | None:
    return no("PodsRefused", f"{name}: the API server refuses its pods: {words}") if words else None


def _refusal_in(status: Mapping[str, Any]) -> str:
    """Return why the API server refuses a Deployment's pods; other workloads do not have it in their status."""
    for condition in status.get("conditions") or ():
        if condition.get("type") == "ReplicaFailure" and condition.get("status") == "True":
            return str(condition.get("message") or condition.get("reason") or "")
    return ""


def podless(manifest: Manifest) -> bool:
    """Return whether a workload wants pods, has none, and would not report why."""
    status: Mapping[str, Any] = manifest.get("status") or {}
    if kind_of(manifest) == JOB:
        return not any(status.get(field) for field in ("active", "succeeded", "failed", "completionTime"))
    wanted = int((manifest.get("spec") or {}).get("replicas", 1))
    return kind_of(manifest) == STATEFUL_SET and wanted > 0 and not int(status.get("replicas") or 0)


def _ended(pod: Manifest) -> bool:
    return (pod.get("status") or {}).get("phase") in ("Succeeded", "Failed")
