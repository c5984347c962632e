"""How many pods a pool has: what an autoscaler asked of the Deployment, within what the resource allows."""

from __future__ import annotations

from robot_offload.kube.port import Manifest
from robot_offload.objects.labels import MOST_PODS


def followed(wanted: Manifest, live: Manifest) -> Manifest:
    """Return a Deployment with the number of pods that the live one was scaled to, where an autoscaler may do that.

    Zero is ours: a pool without a robot has no pods, and an autoscaler leaves a Deployment with none alone.

    Args:
        wanted: a child; `spec.replicas` is the least number, an annotation the largest.
        live: the same object in the cluster.
    """
    most = (wanted["metadata"].get("annotations") or {}).get(MOST_PODS)
    least = (wanted.get("spec") or {}).get("replicas", 0)
    asked = (live.get("spec") or {}).get("replicas", 1)
    if most is None or not least or not asked:
        return wanted
    return {**wanted, "spec": {**wanted["spec"], "replicas": max(least, min(int(most), asked))}}
