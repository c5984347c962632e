"""A live RobotOffload as an API server returns it, and changes to it."""

from __future__ import annotations

import copy
import datetime
from typing import Any

from robot_offload.insight.observed import Observed, observe
from tests.unit.specs import sample

NOW = datetime.datetime(2026, 11, 21, 10, 10, 0, tzinfo=datetime.UTC)
ENDPOINTS = [
    {"purpose": purpose, "protocol": protocol, "host": "203.0.113.7", "port": port}
    for purpose, protocol, port in (
        ("pulse", "UDP", 7447),
        ("data", "UDP", 7448),
        ("pulse-fallback", "TCP", 7447),
        ("data-fallback", "TCP", 7448),
    )
]
CONDITIONS = {
    "SpecValid": ("True", "Valid", "The specification is valid"),
    "ResourcesApplied": ("True", "Applied", "fine"),
    "DiscoveryReady": ("True", "Available", "2 of 2 discovery servers are ready"),
    "WorkloadsAvailable": ("True", "Available", "fine"),
    "Connected": ("True", "Connected", "connected"),
    "ConfigCurrent": ("True", "Current", "The robot runs generation 3"),
    "CertificatesReady": ("True", "Issued", "fine"),
    "AddressesReady": ("True", "Known", "fine"),
    "Ready": ("True", "Ready", "The cloud can act for the robot"),
}


def manifest(**conditions: tuple[str, str, str]) -> dict[str, Any]:
    """A RobotOffload that is Ready; keyword arguments replace conditions: `Ready=("False", "Reason", "message")`."""
    values = sample()
    for node in values["spec"]["nodes"]:
        if node["placement"] != "Robot":
            node["image"] = "registry.example/node:1"
            node.setdefault("run", {"command": ["node"]})
    values["metadata"] |= {
        "namespace": "ward",
        "uid": "6b1f",
        "generation": 3,
        "creationTimestamp": "2026-11-21T08:10:00Z",
    }
    values["status"] = {
        "observedGeneration": 3,
        "placement": "Cloud",
        "placementReason": "LinkGood",
        "placementMessage": "the link sustains the cloud",
        "robot": {"connected": True, "since": "2026-11-21T10:00:00Z", "generation": 3},
        "nodesReady": "2/2",
        "nodes": [
            {"name": "controller", "workload": "w-controller", "replicas": 1, "ready": True},
            {"name": "planner", "workload": "w-planner", "replicas": 1, "ready": True},
        ],
        "endpoints": copy.deepcopy(ENDPOINTS),
        "conditions": [
            {
                "type": name,
                "status": status,
                "reason": reason,
                "message": message,
                "lastTransitionTime": "2026-11-21T10:07:00Z",
            }
            for name, (status, reason, message) in {**CONDITIONS, **conditions}.items()
        ],
    }
    return values


def observed(**conditions: tuple[str, str, str]) -> Observed:
    """The same as the command line sees it."""
    return observe(manifest(**conditions))
