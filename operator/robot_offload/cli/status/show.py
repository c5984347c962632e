"""What `status` shows: rows and texts from an observed RobotOffload and the live state of its agent. Pure."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from robot_offload.api.agent_state import AgentState
from robot_offload.cli.cluster import Live
from robot_offload.insight import in_flight
from robot_offload.insight.observed import Observed, ago

UNKNOWN = "-"
_COLOURS = {"True": "green", "False": "red", "Unknown": "yellow"}


def table(
    offloads: Sequence[Observed], lives: Sequence[Live], now: datetime.datetime, *, namespaces: bool = False
) -> Table:
    """Return one line for each RobotOffload.

    Args:
        offloads: what to show.
        lives: the live state of each.
        now: the present.
        namespaces: whether they come from more than one namespace.
    """
    shown = Table(box=None, pad_edge=False, header_style="bold")
    for heading in (["NAMESPACE"] if namespaces else []) + [
        "NAME", "PLACEMENT", "REASON", "ROBOT", "LATENCY", "NODES", "READY", "AGE",
    ]:  # fmt: skip
        shown.add_column(heading, no_wrap=True)
    for offload, live in zip(offloads, lives, strict=True):
        start = [Text(offload.namespace)] if namespaces else []
        shown.add_row(*start, *_row(offload, live, now))
    return shown


def _row(offload: Observed, live: Live, now: datetime.datetime) -> Iterator[Text]:
    yield Text(offload.name)
    yield Text(placement(offload, live))
    yield Text(placement_reason(offload, live) or UNKNOWN)
    yield _robot(offload, live, now)
    yield Text(latency(live.state))
    yield Text(offload.nodes_ready or UNKNOWN)
    yield _ready(offload)
    yield Text(ago(offload.created, now) or UNKNOWN)


def placement(offload: Observed, live: Live) -> str:
    """Return the active side: as the agent reports now, else from the status."""
    return live.state.site.capitalize() if live.state is not None else offload.placement


def placement_reason(offload: Observed, live: Live) -> str:
    """Return why that side acts, as one word."""
    return live.state.reason if live.state is not None else offload.placement_reason


def latency(state: AgentState | None) -> str:
    """Return the round trip: `12 ms (p99 19 ms)`; a dash while it is not known."""
    if state is None or not state.connected or state.round_trip_p50_ms is None:
        return UNKNOWN
    median = f"{state.round_trip_p50_ms:.0f} ms"
    return median if state.round_trip_p99_ms is None else f"{median} (p99 {state.round_trip_p99_ms:.0f} ms)"


def _robot(offload: Observed, live: Live, now: datetime.datetime) -> Text:
    connected = live.state.connected if live.state is not None else offload.connected
    since = live.state.since if live.state is not None else offload.since
    how_long = ago(since, now)
    words = "connected" if connected else ("gone" if offload.since or how_long else "never seen")
    return Text(f"{words} {how_long}".strip(), style="green" if connected else "yellow")


def _ready(offload: Observed) -> Text:
    condition = offload.condition("Ready")
    if condition is None:
        return Text("no status", style="yellow")
    if offload.outdated:
        return Text("in progress", style="yellow")
    text = "yes" if condition.holds else condition.reason or "no"
    return Text(text, style=_COLOURS.get(condition.status, ""))


def details(offload: Observed, live: Live, now: datetime.datetime) -> Group:
    """Return everything about one RobotOffload."""
    parts: list[RenderableType] = [_facts(offload, live, now)]
    if offload.nodes:
        parts += [Text(), _nodes(offload, live)]
    if offload.endpoints:
        parts += [Text(), _endpoints(offload)]
    if offload.conditions:
        parts += [Text(), _conditions(offload, now)]
    return Group(*parts)


def _facts(offload: Observed, live: Live, now: datetime.datetime) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column()
    state = live.state
    message = state.message if state is not None else offload.placement_message
    reason = placement_reason(offload, live)
    grid.add_row("RobotOffload", Text(f"{offload.namespace}/{offload.name}, transport {offload.transport}"))
    why = ": ".join(part for part in (reason, message) if part)
    grid.add_row("Placement", Text(placement(offload, live) + (f", {why}" if why else "")))
    if offload.pin != "Auto" or offload.mode != "Auto" or offload.replicas == 0:
        grid.add_row("Held by", Text(_held_by(offload)))
    grid.add_row("Robot", _robot(offload, live, now))
    grid.add_row("Round trip", Text(latency(state)))
    if state is not None:
        for heading, words in (
            ("Goals", in_flight.goals(state) if declares(offload, "actions") else ""),
            ("Calls", in_flight.calls(state) if declares(offload, "services") else ""),
            ("State", in_flight.state_ages(state)),
        ):
            if words:
                grid.add_row(heading, Text(words))
    grid.add_row("Settings", Text(settings(offload, state)))
    grid.add_row("Ready", _ready(offload))
    if live.problem:
        grid.add_row("Live numbers", Text(f"not available: {live.problem}", style="yellow"))
    return grid


def declares(offload: Observed, what: str) -> bool:
    """Return whether a node serves or uses `what`: `actions` or `services`."""
    nodes = [node for node in offload.spec.get("nodes") or () if isinstance(node, Mapping)]
    return any(node.get(what) or (node.get("uses") or {}).get(what) for node in nodes)


def _held_by(offload: Observed) -> str:
    held = []
    if offload.pin != "Auto":
        until = f" until {offload.pinned_until}" if offload.pinned_until else ""
        held.append(f"pin {offload.pin}{until} (kubectl offload pin {offload.name} auto lets go)")
    if offload.mode != "Auto":
        held.append(f"mode {offload.mode}: it decides and never switches")
    if offload.replicas == 0:
        held.append("replicas 0: the cloud side is switched off")
    return "; ".join(held)


def settings(offload: Observed, state: AgentState | None) -> str:
    """Return which generation of the resource the robot runs."""
    running = offload.robot_generation
    if state is not None and state.settings.robot_generation is not None:
        running = state.settings.robot_generation
    if running is None:
        return f"generation {offload.generation}; the robot has not said which one it runs"
    if running == offload.generation:
        return f"generation {running}, current on the robot"
    refused = state is not None and state.settings.accepted is False
    why = f": {state.settings.reason}, {state.settings.message}" if refused and state is not None else ""
    return f"the robot runs generation {running} of {offload.generation}{why}"


def _nodes(offload: Observed, live: Live) -> Table:
    states = dict(live.state.nodes) if live.state is not None else {}
    built = any(node.commit for node in offload.nodes)
    shown = _list("NODE", "POD", "LIFECYCLE", *(["COMMIT"] if built else []), "MESSAGE")
    for node in offload.nodes:
        ready = "ready" if node.ready else ("not ready" if node.replicas else "none")
        style = "green" if node.ready else ("red" if node.replicas else "")
        shown.add_row(
            *_texts(node.name),
            Text(ready, style=style),
            *_texts(states.get(node.name, UNKNOWN)),
            *(_texts(node.commit[:12] or UNKNOWN) if built else []),
            *_texts(node.message),
        )
    return shown


def _endpoints(offload: Observed) -> Table:
    shown = _list("ENDPOINT", "PROTOCOL", "ADDRESS")
    for endpoint in offload.endpoints:
        shown.add_row(*_texts(endpoint.purpose, endpoint.protocol, endpoint.address))
    return shown


def _conditions(offload: Observed, now: datetime.datetime) -> Table:
    shown = _list("CONDITION", "STATUS", "REASON", "SINCE", "MESSAGE")
    for condition in offload.conditions:
        status = Text(condition.status, style=_COLOURS.get(condition.status, ""))
        since = ago(condition.since, now)
        shown.add_row(*_texts(condition.type), status, *_texts(condition.reason, since, condition.message))
    return shown


def _texts(*words: str) -> list[Text]:
    """Return foreign words literally: in a plain string brackets would be read as colours."""
    return [Text(word) for word in words]


def _list(*headings: str) -> Table:
    shown = Table(box=None, pad_edge=False, header_style="bold")
    for heading in headings:
        shown.add_column(heading, no_wrap=heading not in {"MESSAGE", "ADDRESS"})
    return shown


def plain(offload: Observed, live: Live) -> dict[str, Any]:
    """Return the same details for programs."""
    state = live.state
    return {
        "namespace": offload.namespace,
        "name": offload.name,
        "placement": placement(offload, live),
        "reason": placement_reason(offload, live),
        "message": state.message if state is not None else offload.placement_message,
        "pin": offload.pin,
        "pinnedUntil": offload.pinned_until or None,
        "mode": offload.mode,
        "robot": {
            "connected": state.connected if state is not None else offload.connected,
            "since": state.since if state is not None else offload.since,
            "generation": offload.robot_generation,
        },
        "roundTripMs": None if state is None else {"p50": state.round_trip_p50_ms, "p99": state.round_trip_p99_ms},
        **in_flight.plain(state),
        "live": not live.problem,
        "liveProblem": live.problem,
        "ready": offload.ready,
        "generation": offload.generation,
        "observedGeneration": offload.observed_generation,
        "nodesReady": offload.nodes_ready,
        "nodes": [
            {
                "name": node.name,
                "ready": node.ready,
                "message": node.message,
                "image": node.image,
                "commit": node.commit,
            }
            for node in offload.nodes
        ],
        "endpoints": [
            {"purpose": each.purpose, "protocol": each.protocol, "host": each.host, "port": each.port}
            for each in offload.endpoints
        ],
        "conditions": [
            {"type": each.type, "status": each.status, "reason": each.reason, "message": each.message}
            for each in offload.conditions
        ],
    }
