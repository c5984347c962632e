"""What becomes of goals, calls and state at a change of sides, in words. Pure, tolerant like `observed`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

_GOALS: Final = {
    "Resend": "go on with the replica of the other side",
    "Hold": "make a planned change wait for their end; after a loss they end aborted",
    "Abort": "end aborted",
}
_CALLS: Final = {
    "Holder": "are executed at most once, by the acting side",
    "Idempotent": "are asked again when it is not known whether they were executed",
    "Both": "are executed on both sides",
    "Race": "are executed on both sides, the first answer counts",
}


def handover(spec: Mapping[str, Any]) -> Iterator[str]:
    """Yields a sentence for each action, service and state that a duplicated node declares, as the resource has it."""
    for node in spec.get("nodes") or ():
        if node.get("placement") != "Duplicated":
            continue
        for action in node.get("actions") or ():
            rule = str(action.get("onSwitch", ""))
            yield f"At a change of sides, goals of {action.get('name')} {_GOALS.get(rule, '')} ({rule})."
        for service in node.get("services") or ():
            rule = str(service.get("mode") or "Holder")
            yield f"Calls of {service.get('name')} {_CALLS.get(rule, '')} ({rule})."
        for state in node.get("state") or ():
            yield f"{node.get('name')} hands over {_kept(state)}."


def _kept(state: Mapping[str, Any]) -> str:
    if state.get("topic"):
        return f"{state['topic']}, which its replica gets as {state.get('restore')}"
    return "its snapshots" if state.get("snapshot") else "its parameters"
