"""How many pods a pool has: the autoscaler's number, within the resource's limits."""

from __future__ import annotations

from robot_offload.kube.port import Manifest
from robot_offload.objects.labels import MOST_PODS


def followed(wanted: Manifest, live: Manifest) -> Manifest:
    """Return a Deployment with the live one's number of pods, if an autoscaler may set it.

    Zero is ours: a pool without a robot has no pods, and an autoscaler does not change a Deployment with zero.

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
