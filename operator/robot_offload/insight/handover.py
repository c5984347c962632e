"""The fate of nodes, outputs, goals, calls and state when the side changes, in words. Pure and tolerant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

_GOALS: Final = {
    "ResendOnLoss": "make a planned switch wait for their end; after a loss they go on with the other side's replica",
    "Resend": "begin anew with the replica of the other side; one that began anew twice keeps its side",
    "Continue": "go on with the replica of the other side",
    "Hold": "make a planned change wait for their end; after a loss they end aborted",
    "Abort": "end aborted",
}
_CALLS: Final = {
    "Holder": "are executed at most once, by the acting side",
    "Idempotent": "are asked again when it is not known whether they were executed",
    "Both": "are executed on both sides",
    "Race": "are executed on both sides, the first answer counts",
}


_SIDES: Final = {"robot": "on the robot", "cloud": "in the cloud"}


def handover(spec: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each declaration of a node about changes of side, as the resource has it."""
    for node in spec.get("nodes") or ():
        if node.get("placement") == "Cloud":
            yield from _results(node)
        if node.get("placement") != "Duplicated":
            continue
        yield from _standby(node)
        for output in node.get("outputs") or ():
            yield from _output(output)
        for action in node.get("actions") or ():
            rule = str(action.get("onSwitch") or "ResendOnLoss")
            yield f"At a change of sides, goals of {action.get('name')} {_GOALS.get(rule, '')} ({rule})."
        for service in node.get("services") or ():
            rule = str(service.get("mode") or "Holder")
            yield f"Calls of {service.get('name')} {_CALLS.get(rule, '')} ({rule})."
        for state in node.get("state") or ():
            yield f"{node.get('name')} hands over {_kept(state)}."


def _results(node: Mapping[str, Any]) -> Iterator[str]:
    topics = ", ".join(str(output.get("topic")) for output in node.get("outputs") or ())
    if topics:
        yield (
            f"{node.get('name')} runs in the cloud only: {topics} reach the robot whichever side acts, or are silent; "
            "/offload/available says why."
        )


def _standby(node: Mapping[str, Any]) -> Iterator[str]:
    if node.get("lifecycle") is False:
        yield f"{node.get('name')} has no lifecycle: it runs on both sides all the time, one of them is heard."
        return
    standby = node.get("standby") or {}
    hot = [where for side, where in _SIDES.items() if standby.get(side) == "Hot"]
    if hot:
        yield f"{node.get('name')} stays Active {' and '.join(hot)} while the other side acts (Hot)."


def _output(output: Mapping[str, Any]) -> Iterator[str]:
    topic, condition = output.get("topic"), output.get("while")
    if condition:
        busy = [f"a goal of {name} is executed" for name in condition.get("actions") or ()]
        within = f" (each counts for {condition['within']})" if condition.get("within") else ""
        busy += [f"{condition['topic']} arrives{within}"] if condition.get("topic") else []
        yield f"{topic} is expected to speak only while {' or '.join(busy)}."
    frames = ", ".join(f"{frame.get('parent')} -> {frame.get('child')}" for frame in output.get("frames") or ())
    if frames or output.get("shared"):
        part = f", {frames} of the acting side" if frames else ""
        yield f"{topic} is shared: both sides hear all that others publish there{part}."


def _kept(state: Mapping[str, Any]) -> str:
    if state.get("topic"):
        return f"{state['topic']}, which its replica gets as {state.get('restore')}"
    return "its snapshots" if state.get("snapshot") else "its parameters"
