"""A state of the cloud agent as it stands in its file, and as it was seen."""

from __future__ import annotations

import json
from typing import Any

from robot_offload.api.agent_state import Sight, look

SINCE = "2026-11-21T10:00:00Z"


def text(**changes: Any) -> str:
    """The text of a state file; keyword arguments replace fields."""
    values: dict[str, Any] = {
        "version": 1,
        "written": "2026-11-21T10:05:00Z",
        "agent_generation": 3,
        "connected": True,
        "since": SINCE,
        "site": "cloud",
        "epoch": 12,
        "reason": "LinkGood",
        "message": "the link sustains the cloud",
        "round_trip_ms": {"p50": 11.5, "p99": 19.0},
        "carried": [{"topic": "/scan", "bytes": 123456}],
        "state_ages": [{"name": "controller_1", "age_ms": 85}],
        "nodes": [{"name": "controller", "state": "active"}],
        "settings": {"robot_generation": 3, "accepted": True, "reason": "Accepted", "message": "in use"},
        "ready": True,
    }
    return json.dumps(values | changes)


def seen(at_s: float = 100.0, **changes: Any) -> Sight:
    """A state file that was seen to change at `at_s`."""
    return look(Sight(), text(**changes), at_s)
