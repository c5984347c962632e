"""A state of the cloud agent as it stands in its file, and as it was seen."""

from __future__ import annotations

import json
from typing import Any

from robot_offload.api.agent_state import Sight, look

SINCE = "2026-11-21T10:00:00Z"

REPORT: dict[str, Any] = {
    "version": 1, "release": "0.1.0", "site": "robot", "phase": "Robot", "latency_ms": 11.8, "loss_share": 0.01,
    "limit_ms": 100.0, "clock_offset_ms": -0.4, "ready": True, "beats": [1000, 7],
    "latency": [168, 0, 0, 14, *[0] * 11], "changeovers": [["cloud", "LinkGood", 2], ["robot", "HeartbeatLost", 2]],
    "losses": [2, 1, 190], "gaps": {"/cmd_vel": [50, 1200, 1, 2, 0, 9, *[0] * 8]},
    "processes": {"control": [1500, 2, 0]}, "goals": {"/go": [3, 0, 1]},
    "actions": {"/go": [1, 2, 4]}, "services": {"/plan": 3}, "used": [1, 0], "refused": {"TooOld": 5},
    "changeover": {"to": "cloud", "reason": "LinkGood", "ago_s": 40.0, "gap_ms": 61.5}, "ages": {"/cmd_vel": 14},
    "topics": {"/scan": [100, 0, 4, 1]}, "nodes": {"controller": "active"}, "states": {"amcl": 80}, "left_out": 2,
}  # fmt: skip
"""What a robot says of itself."""


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
        "carried": [{"topic": "/scan", "direction": "to_cloud", "bytes": 123456, "messages": 400, "age_ms": 9}],
        "state_ages": [{"name": "controller_1", "age_ms": 85}],
        "nodes": [{"name": "controller", "state": "active"}],
        "settings": {"robot_generation": 3, "accepted": True, "reason": "Accepted", "message": "in use"},
        "ready": True,
    }
    return json.dumps(values | changes)


def seen(at_s: float = 100.0, **changes: Any) -> Sight:
    """A state file that was seen to change at `at_s`."""
    return look(Sight(), text(**changes), at_s)
