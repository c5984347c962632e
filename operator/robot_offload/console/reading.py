"""What others wrote (state of an agent, event of the stream, specification), read without trust. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.api.agent_state import AgentState, StateError, parse_state
from robot_offload.api.v1alpha1.switching import Switching
from robot_offload.console.live import CLOUD, ROBOT, SITES, UNKNOWN, Bounds, Live, NodeState, TopicFlow

MAX_NUMBERS: Final = 64
MAX_WORD: Final = 120
_RULE: Final = ("latency", "profile", "heartbeatPeriod", "lossTimeout", "holdDown")
"""What of spec.switching is drawn; the rest may be of another version."""


class EventError(ValueError):
    """A line of the stream that is no event of a reporter, or says why there is no state."""


def of_event(data: str) -> tuple[float, Live]:
    """Returns the moment (unix seconds) and the word of one event of the reporter's stream.

    Raises:
        EventError: the line is unreadable, or the reporter says why it has no state.
    """
    try:
        values = json.loads(data)
        at, state = float(values["at"]), values["state"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise EventError("the reporter's stream is unreadable") from error
    if not isinstance(state, Mapping):
        raise EventError(word(values.get("problem") or "the agent has not written its state yet"))
    return at, of_state(state, values.get("robot"))


def of_state(state: Mapping[str, Any], robot: object = None) -> Live:
    """Returns the word of an agent's state and of the robot's report beside it.

    Raises:
        EventError: the state is none.
    """
    try:
        parsed = parse_state(json.dumps(state))
    except (StateError, ValueError, RecursionError) as error:
        raise EventError(str(error)) from error
    link = state.get("link")
    link = link if isinstance(link, Mapping) else {}
    report = robot if isinstance(robot, Mapping) else {}
    latency_ms = number(link.get("latency_ms"))
    return Live(
        site=parsed.site if parsed.site in SITES else UNKNOWN,
        reason=parsed.reason,
        message=parsed.message,
        epoch=parsed.epoch,
        connected=parsed.connected,
        latency_ms=latency_ms if link else parsed.round_trip_p50_ms,
        cut=bool(link) and latency_ms is None,
        loss_share=number(link.get("loss_share")),
        p50_ms=parsed.round_trip_p50_ms,
        p99_ms=parsed.round_trip_p99_ms,
        nodes=_nodes(parsed, report),
        topics=tuple(TopicFlow(topic, size_bytes=count) for topic, count in parsed.carried),
        state_ages_ms=tuple((name, float(age_ms)) for name, age_ms in parsed.state_ages_ms),
        numbers=tuple(numbers(report)),
    )


def _nodes(state: AgentState, report: Mapping[str, Any]) -> tuple[NodeState, ...]:
    cloud = [NodeState(name, CLOUD, word) for name, word in state.nodes]
    listed = report.get("nodes")
    robot = [
        NodeState(word(each.get("name", "")), ROBOT, word(each.get("state", "")))
        for each in (listed if isinstance(listed, list) else ())[:MAX_NUMBERS]
        if isinstance(each, Mapping)
    ]
    return (*robot, *cloud)


def numbers(report: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yields the figures of a report as name and value, those of parts with the part's name in front."""
    for name, value in list(report.items())[:MAX_NUMBERS]:
        label = word(f"{prefix}{name}")
        if isinstance(value, Mapping) and not prefix:
            yield from numbers(value, f"{label}.")
        elif isinstance(value, bool | int | str):
            yield label, word(value)
        elif isinstance(value, float):
            yield label, f"{value:.4g}"


def word(value: object) -> str:
    """Returns a foreign value as one short line."""
    text = " ".join(str(value).split())
    return text if len(text) <= MAX_WORD else f"{text[: MAX_WORD - 3]}..."


def number(value: object) -> float | None:
    """Returns a finite number, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    found = float(value)
    return found if abs(found) < 1e15 else None


def bounds(spec: Mapping[str, Any]) -> Bounds:
    """Returns the rule's numbers of a specification as it is written; none where this version cannot read it."""
    written = spec.get("switching") or {}
    try:
        rule = Switching.model_validate({name: written[name] for name in _RULE if name in written})
    except (ValueError, TypeError, KeyError):
        return Bounds()
    return Bounds(
        allowed_ms=float(rule.latency.allowed_loop_ms),
        loss_timeout_ms=float(rule.loss_timeout_ms),
        hold_down_s=(rule.hold_down.initial_ms / 1e3, rule.hold_down.max_ms / 1e3),
    )
