"""What the controller remembers of an object between two passes. Losing it costs reads, never correctness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from robot_offload.kube.port import Manifest
from robot_offload.reconcile.drift import Settled
from robot_offload.reconcile.ownership import Key
from robot_offload.reconcile.presence import Sighting


@dataclass(slots=True)
class Memory:
    """Of one RobotOffload, by its uid.

    Attributes:
        uid: whose memory it is; another uid under the same name starts anew.
        generation: the highest one seen: an answer with a lower one is stale.
        settled: what the API server made of manifests in its own way of writing.
        sighting: the robot's Lease.
        config_maps: names of the ConfigMaps of users that it reads.
        lease: the robot's Lease, as it was last read.
        versions: resourceVersion by uid of all that the last pass read or wrote: events about those are no news.
        status: the status as it was last seen or written, for the metrics.
    """

    uid: str
    generation: int = 0
    settled: dict[Key, Settled] = field(default_factory=dict)
    sighting: Sighting | None = None
    config_maps: frozenset[str] = frozenset()
    lease: Manifest | None = None
    versions: dict[str, str] = field(default_factory=dict)
    status: Mapping[str, Any] = field(default_factory=dict)
