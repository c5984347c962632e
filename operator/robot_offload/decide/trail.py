"""The head of a robot's audit trail in the status: out of the robot's reach, written at most once a minute. Pure.

With the newest entry's number and digest, a cut or rewritten trail is noticed (`audit verify --head`).
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Any, Final

from robot_offload.decide.conditions import timestamp

LEAST_S: Final = 60.0
"""A steadily growing trail costs one write of the status in this time."""


def shown(audit: str, before: Mapping[str, Any], now: datetime.datetime) -> tuple[dict[str, Any], float | None]:
    """Return the trail's part of the status, and the seconds after which to look again; None: only after a change.

    Args:
        audit: NUMBER:DIGEST, as the robot's agent reports; empty: it reports nothing now.
        before: `status.audit` as it was last written.
        now: our wall clock.
    """
    if not audit or audit == before.get("head"):
        return dict(before), None
    seen = _time(before.get("seen"))
    left_s = LEAST_S - abs((now - seen).total_seconds()) if seen is not None else 0.0
    if left_s > 0:
        return dict(before), left_s
    return {"entries": int(audit.partition(":")[0]), "head": audit, "seen": timestamp(now)}, None


def restarted(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return the sentence about a trail that does not continue the last seen one; empty: it does, or may."""
    known, found = int(before.get("entries") or 0), int(after.get("entries") or 0)
    if not known or before.get("head") == after.get("head") or found > known:
        return ""
    return (
        f"The robot's audit trail had entry {before.get('head')} and its newest is {after.get('head')} now: the "
        "agent was installed anew, or the trail was cut or written anew"
    )


def _time(text: object) -> datetime.datetime | None:
    try:
        moment = datetime.datetime.fromisoformat(text) if isinstance(text, str) else None
    except ValueError:
        return None
    return moment if moment is not None and moment.tzinfo else None
