"""The status of a RobotOffload, built once a pass from all findings."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.pinned import NO_PIN, Hold
from robot_offload.decide import builds, conditions
from robot_offload.decide.agent import Placement
from robot_offload.decide.ownership import Key
from robot_offload.decide.presence import Presence, Wanted
from robot_offload.decide.verdicts import Verdict
from robot_offload.decide.workloads import pods_of, workload
from robot_offload.kube.kinds import DEPLOYMENT
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint
from robot_offload.objects.labels import selector
from robot_offload.objects.names import node_child


@dataclass(frozen=True, slots=True)
class Found:
    """The findings of a pass about a valid RobotOffload.

    Attributes:
        robot: its presence.
        robot_generation: the generation whose settings the robot runs.
        dials: addresses of the cloud in the robot's bundle.
        placement: which side acts.
        endpoints: the cloud's addresses for the robot.
        wanted: which pods of nodes are wanted.
        live: the children as they are now.
        commits: the source commits of the nodes' images, by node.
        certificates: serial numbers and ends, as in the status.
        pods: the children's pods, as far as they were read.
        hold: the pin in force.
        audit: the robot's audit trail, as in the status.
    """

    robot: Presence
    robot_generation: int | None
    placement: Placement
    endpoints: tuple[Endpoint, ...]
    wanted: Wanted
    live: Mapping[Key, Manifest]
    pods: tuple[Manifest, ...] = ()
    commits: Mapping[str, str] = field(default_factory=dict)
    certificates: Mapping[str, Any] = field(default_factory=dict)
    dials: tuple[str, ...] = ()
    hold: Hold = NO_PIN
    audit: Mapping[str, Any] = field(default_factory=dict)


def build(
    before: Mapping[str, Any],
    generation: int,
    verdicts: Mapping[str, Verdict],
    now: datetime.datetime,
    offload: RobotOffload | None = None,
    found: Found | None = None,
) -> dict[str, Any]:
    """Return the status to write.

    Args:
        before: the present status; what a pass could not find out is kept.
        generation: of the specification.
        verdicts: by type of condition, without Ready.
        now: our wall clock.
        offload: the resource, if it is valid.
        found: the rest, if the resource is valid and the cluster could be read.
    """
    status = dict(before)
    status["observedGeneration"] = generation
    status["conditions"] = conditions.conditions(verdicts, before.get("conditions") or (), generation, now)
    if offload is not None and found is not None:
        status.update(_found(offload, found))
    return status


def patch(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Return the merge patch from one status to the other; empty: they are equal."""
    result: dict[str, Any] = {}
    for key in {*before, *after}:
        old, new = before.get(key), after.get(key)
        if old == new:
            continue
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            result[key] = patch(old, new)
        else:
            result[key] = new
    return result


def _found(offload: RobotOffload, found: Found) -> dict[str, Any]:
    nodes = list(_nodes(offload, found))
    running = [node for node in nodes if node["replicas"]]
    return {
        "placement": found.placement.site,
        "placementReason": found.placement.reason,
        "placementMessage": found.placement.message,
        "pin": _pin(found.hold),
        **({"audit": dict(found.audit)} if found.audit else {}),
        "robot": _robot(found),
        "endpoints": [
            {"purpose": point.purpose, "protocol": point.protocol, "host": point.host, "port": point.port}
            for point in found.endpoints
        ],
        "certificates": dict(found.certificates),
        "nodes": nodes,
        "nodesReady": f"{sum(node['ready'] for node in running)}/{len(nodes)}",
        "replicas": int(bool(running)),
        "selector": ",".join(f"{key}={value}" for key, value in sorted(selector(offload, "node").items())),
    }


def _robot(found: Found) -> dict[str, Any]:
    robot: dict[str, Any] = {"connected": found.robot.connected, "since": conditions.timestamp(found.robot.since)}
    if found.robot_generation is not None:
        robot["generation"] = found.robot_generation
    if found.dials:
        robot["dials"] = list(found.dials)
    if found.robot.last_seen is not None:
        robot["lastSeen"] = conditions.timestamp(found.robot.last_seen)
    return robot


def _pin(hold: Hold) -> dict[str, Any]:
    pin = {"side": hold.side}
    if hold.until is not None:
        pin["until"] = conditions.timestamp(hold.until)
    if hold.ended:
        pin["ended"] = hold.ended
    return pin


def _nodes(offload: RobotOffload, found: Found) -> Iterable[dict[str, Any]]:
    for node in offload.spec.cloud_nodes:
        name = node_child(offload.metadata.name, node.name)
        deployment = found.live.get((DEPLOYMENT, name))
        entry: dict[str, Any] = {"name": node.name, "workload": name, "replicas": 0, "ready": False}
        if deployment is None:
            built = node.build is not None
            entry["message"] = "its image is not built yet; see ImageBuilt" if built else "its Deployment is missing"
        else:
            entry["image"] = builds.image_of(deployment)
            if commit := found.commits.get(node.name):
                entry["commit"] = commit
            verdict = workload(deployment, pods_of(deployment, found.pods))
            entry["replicas"] = int((deployment.get("spec") or {}).get("replicas", 1))
            entry["ready"] = verdict.holds and entry["replicas"] > 0
            if not verdict.holds or not entry["replicas"]:
                entry["message"] = verdict.message
        yield entry
