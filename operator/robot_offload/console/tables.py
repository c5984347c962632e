"""The small tables of one robot's page as plain values. Pure: unknown values are marked as such."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Any, Final

from robot_offload.console.live import CLOUD, ROBOT, Changeover, Live
from robot_offload.console.model import Track
from robot_offload.insight.observed import ago, time_of

Row = dict[str, Any]
STATES: Final = {"active": "● active", "inactive": "○ inactive", "unconfigured": "◌ unconfigured"}


def nodes(track: Track, live: Live) -> list[Row]:
    """Return a line for each replica: its declaration, and its lifecycle state on each side."""
    declared = {str(node.get("name")): node for node in _listed(track.manifest.get("spec") or {}, "nodes")}
    found = {(node.name.removeprefix("remote_"), node.side): node for node in live.nodes}
    ready = {node.name: node for node in track.observed.nodes} if track.observed else {}
    names = dict.fromkeys([*declared, *(name for name, _ in found)])
    rows = []
    for name in names:
        node = declared.get(name, {})
        standby = (node.get("standby") or {}) if node.get("placement") == "Duplicated" else {}
        seen = ready.get(name)
        pod = "" if seen is None else ("ready" if seen.ready else seen.message or "not ready")
        rows.append(
            {
                "node": name,
                "placement": str(node.get("placement") or ""),
                "robot": _state(found, name, ROBOT),
                "cloud": _state(found, name, CLOUD),
                "standby": ", ".join(f"{side} {word}" for side, word in sorted(standby.items())),
                "core": "core" if node.get("core") else "",
                "pod": pod,
            }
        )
    return rows


def _state(found: Mapping[tuple[str, str], Any], name: str, side: str) -> str:
    node = found.get((name, side))
    return "" if node is None else STATES.get(node.state, node.state)


def topics(track: Track, live: Live, t_s: float) -> list[Row]:
    """Return a line for each topic that crossed the link or reached the consumers."""
    rates = track.rates(t_s)
    rows = []
    for flow in live.topics:
        messages_per_s, bytes_per_s = rates.get(flow.topic, (None, None))
        rows.append(
            {
                "topic": flow.topic,
                "rate": "" if messages_per_s is None else f"{messages_per_s:.1f} Hz",
                "bandwidth": "" if bytes_per_s is None else f"{size(bytes_per_s)}/s",
                "age": "" if flow.age_ms is None else f"{flow.age_ms:.0f} ms",
                "carried": "" if flow.size_bytes is None else size(flow.size_bytes),
                "messages": "" if flow.messages is None else str(flow.messages),
                "leftOut": flow.left_out,
            }
        )
    return rows


def handed(live: Live) -> list[Row]:
    """Return a line for each goal, service and state that is handed over."""
    goals = [{"what": each.name, "state": each.state, "detail": each.detail} for each in (*live.goals, *live.services)]
    ages = [{"what": f"state {name}", "state": f"{age:.0f} ms old", "detail": ""} for name, age in live.state_ages_ms]
    return [*goals, *ages]


def changeovers(track: Track, *, run: bool) -> list[Row]:
    """Return the changeovers, the newest first."""
    return [
        {
            "when": when(change.t_s, run=run),
            "to": change.to,
            "reason": ": ".join(part for part in (change.reason, change.message) if part),
            "gap": _gap(change),
        }
        for change in reversed(track.changeovers)
    ]


def _gap(change: Changeover) -> str:
    return "" if change.gap_ms is None else f"{change.gap_ms:.0f} ms"


def conditions(track: Track, now: datetime.datetime) -> list[Row]:
    """Return the conditions of the resource."""
    return [
        {
            "type": each.type,
            "status": {"True": "✓ True", "False": "✗ False"}.get(each.status, f"? {each.status}"),
            "why": f"{each.reason}: {each.message}" if each.message else each.reason,
            "since": ago(each.since, now),
        }
        for each in (track.observed.conditions if track.observed else ())
    ]


def endpoints(track: Track) -> list[Row]:
    """Return the addresses at which the robot reaches the cloud."""
    return [
        {"purpose": each.purpose, "address": f"{each.host}:{each.port}/{each.protocol}"}
        for each in (track.observed.endpoints if track.observed else ())
    ]


def certificates(track: Track, now: datetime.datetime) -> list[Row]:
    """Return the certificates and when they end."""
    status = track.manifest.get("status") or {}
    rows = []
    for owner, certificate in (status.get("certificates") or {}).items():
        end = time_of(str((certificate or {}).get("notAfter") or ""))
        if end is not None:
            left = end - now
            rows.append(
                {
                    "owner": str(owner),
                    "serial": str(certificate.get("serial") or ""),
                    "ends": f"{end:%Y-%m-%d %H:%M} UTC",
                    "left": "has ended" if left.total_seconds() < 0 else f"in {left.days} days",
                }
            )
    return rows


def size(count: float) -> str:
    """Return a number of bytes for people: `640 B`, `12.3 kB`, `4.5 MB`."""
    for unit, factor in (("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.1f} {unit}"
    return f"{count:.0f} B"


def when(t_s: float, *, run: bool) -> str:
    """Return a moment: seconds of a run, or the time of day (UTC)."""
    if run:
        return f"{t_s:.1f} s"
    return datetime.datetime.fromtimestamp(t_s, datetime.UTC).strftime("%H:%M:%S UTC")


def _listed(values: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    found = values.get(name)
    return [each for each in found if isinstance(each, Mapping)] if isinstance(found, list | tuple) else []
