"""The last author of a RobotOffload's specification, as far as the API server keeps it: program and time. Pure.

The API server stores no users; `metadata.managedFields` names the field manager, which kubectl, Argo CD and consoles
choose themselves. So this leads to the API server's own audit log, but proves nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL, Hold

_NAME: Final = re.compile(r"[ -~]{1,128}")
"""Field managers have at most 128 printable characters."""
_TIME: Final = re.compile(r"[0-9TZ:.+-]{1,40}")


def kept(metadata: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the field managers that last wrote the specification, or the end of its pin; or none.

    The API server keeps whole seconds: the order of two writes within one second is unknown.
    """
    wrote = [entry for entry in _entries(metadata) if not entry.get("subresource") and _wrote(entry.get("fieldsV1"))]
    found = [(str(entry.get("time") or ""), str(entry.get("manager") or "")) for entry in wrote]
    latest = max((time for time, _ in found), default="")
    fine = {name for time, name in found if time == latest and _NAME.fullmatch(name) and _TIME.fullmatch(time)}
    return [{"manager": name, "time": latest} for name in sorted(fine)]


def author(metadata: Mapping[str, Any], hold: Hold) -> str:
    """Return who changed what the robot is offered: field managers with a time, or the end of a pin.

    Args:
        metadata: of the RobotOffload, with all `managedFields` or with the kept ones.
        hold: the pin in force.
    """
    found = kept(metadata)
    wrote = f"{' or '.join(each['manager'] for each in found)} at {found[0]['time']}" if found else ""
    return f"{wrote or 'somebody'}; the end of the pin: {hold.ended}" if hold.ended else wrote


def _entries(metadata: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    found = metadata.get("managedFields")
    return [each for each in found if isinstance(each, Mapping)] if isinstance(found, list) else []


def _wrote(fields: object) -> bool:
    """Return whether an entry owns a part of the specification or the end of a pin."""
    if not isinstance(fields, Mapping):
        return fields is None
    annotations = (fields.get("f:metadata") or {}).get("f:annotations") or {}
    return "f:spec" in fields or f"f:{PINNED_UNTIL}" in annotations
