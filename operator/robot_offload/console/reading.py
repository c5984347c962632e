"""Foreign texts (state of an agent, event of the stream, specification), read without trust. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from robot_offload.api.agent_state import AgentState, StateError, parse_state
from robot_offload.api.side_numbers import OUTCOMES, SideNumbers, parse_numbers
from robot_offload.api.v1alpha1.switching import Switching
from robot_offload.console.live import (
    CLOUD,
    ROBOT,
    SITES,
    UNKNOWN,
    Bounds,
    Changeover,
    Errand,
    Live,
    NodeState,
    TopicFlow,
)
from robot_offload.insight import in_flight

MAX_NUMBERS: Final = 64
LEFT_OUT: Final = ("over the rate", "thinned", "unsent")
PROCESSES: Final = "processes"
TABLES: Final = frozenset({"nodes", "topics", "ages", "goals", "actions", "services", "used", "states", "changeover"})
"""Parts of the robot's report that are shown in tables of their own."""
MAX_WORD: Final = 120
_RULE: Final = ("latency", "profile", "heartbeatPeriod", "lossTimeout", "holdDown")
"""The parts of spec.switching that are drawn; the others may be of another version."""


class EventError(ValueError):
    """A line of the stream that is not a reporter's event, or that reports why there is no state."""


def of_event(data: str) -> tuple[float, Live]:
    """Parse one event of the reporter's stream into its moment (unix seconds) and report.

    Raises:
        EventError: the line is unreadable, or reports why there is no state.
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
    """Build a report from an agent's state and the robot's report beside it.

    Raises:
        EventError: the state cannot be read.
    """
    try:
        parsed = parse_state(json.dumps(state))
    except (StateError, ValueError, RecursionError) as error:
        raise EventError(str(error)) from error
    link = state.get("link")
    link = link if isinstance(link, Mapping) else {}
    report = robot if isinstance(robot, Mapping) else {}
    said = parse_numbers(report) or SideNumbers()
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
        topics=tuple(_topics(parsed, report)),
        last=_last(report),
        goals=tuple(_goals(said)),
        services=tuple(_calls(said)),
        state_ages_ms=(
            *((name, float(age_ms)) for name, age_ms in parsed.state_ages_ms),
            *(
                (f"{name} on the robot", age)
                for name, each in part(report, "states")
                if (age := number(each)) is not None
            ),
        ),
        numbers=tuple(numbers(report)),
    )


def _nodes(state: AgentState, report: Mapping[str, Any]) -> tuple[NodeState, ...]:
    cloud = [NodeState(name, CLOUD, lifecycle) for name, lifecycle in state.nodes]
    robot = [NodeState(name, ROBOT, word(each)) for name, each in part(report, "nodes")]
    return (*robot, *cloud)


def _topics(state: AgentState, report: Mapping[str, Any]) -> Iterator[TopicFlow]:
    """Yield what crossed the link: bytes counted by the cloud, messages and thinned ones counted by the robot."""
    counted = dict(part(report, "topics"))
    carried = {one.topic: one for one in state.carried}
    ages = {topic: number(age) for topic, age in part(report, "ages")}
    for topic in dict.fromkeys([*carried, *counted, *ages]):
        counts = _counts(counted.get(topic))
        left_out = [f"{count} {name}" for name, count in zip(LEFT_OUT, counts[1:], strict=False) if count]
        crossed = carried.get(topic)
        age_ms = ages.get(topic, crossed.age_ms if crossed else None)
        messages = counts[0] if counts else crossed.messages if crossed else None
        yield TopicFlow(topic, messages, crossed.bytes if crossed else None, age_ms, ", ".join(left_out))


def _goals(robot: SideNumbers) -> Iterator[Errand]:
    """Yield the goals of each action: those in flight, and how the others ended."""
    ended, now = dict(robot.goals), dict(robot.actions)
    for action in dict.fromkeys([*now, *ended]):
        words = [f"{count} {name}" for name, count in zip(OUTCOMES, ended.get(action, ()), strict=False)]
        state = in_flight.goals_of(now[action]) if action in now else "ended"
        yield Errand(f"goals of {action}", state, ", ".join(words))


def _calls(robot: SideNumbers) -> Iterator[Errand]:
    """Yield the calls that wait for an answer, and the calls of the group's nodes to servers outside."""
    for service, count in robot.services:
        yield Errand(f"calls of {service}", f"{count or 'none'} open")
    if robot.used_goals or robot.used_calls:
        state = f"{robot.used_goals or 0} goals, {robot.used_calls or 0} calls open"
        yield Errand("at servers outside", state)


def _last(report: Mapping[str, Any]) -> Changeover | None:
    """Return the last changeover in the robot's report; its time counts back from the report's."""
    said = report.get("changeover")
    said = said if isinstance(said, Mapping) else {}
    ago_s, to = number(said.get("ago_s")), said.get("to")
    if ago_s is None or to not in (ROBOT, CLOUD):
        return None
    return Changeover(-ago_s, str(to), word(said.get("reason") or ""), gap_ms=number(said.get("gap_ms")))


def _counts(value: object) -> list[int]:
    found = value if isinstance(value, list) else []
    return [each for each in found if isinstance(each, int) and not isinstance(each, bool)]


def part(report: Mapping[str, Any], name: str) -> list[tuple[str, Any]]:
    """Return the entries of a part of a report, bounded; none where it is no mapping."""
    found = report.get(name)
    entries = list(found.items()) if isinstance(found, Mapping) else []
    return [(word(key), value) for key, value in entries[:MAX_NUMBERS]]


def numbers(report: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the figures of a report that no other table shows; those of a part are prefixed with its name."""
    for name, value in list(report.items())[:MAX_NUMBERS]:
        label = word(f"{prefix}{name}")
        if not prefix and name in TABLES:
            continue
        if not prefix and name == PROCESSES:
            yield from _processes(report)
        elif isinstance(value, Mapping) and not prefix:
            yield from numbers(value, f"{label}.")
        elif isinstance(value, bool | int | str):
            yield label, word(value)
        elif isinstance(value, float):
            yield label, f"{value:.4g}"
        elif isinstance(value, list):
            yield label, word(", ".join(map(str, value[:MAX_NUMBERS])))


def _processes(report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what each process of the robot's agent used."""
    for name, value in part(report, PROCESSES):
        counts = _counts(value)
        if len(counts) >= 3:
            cpu_ms, memory_kb, deaths = counts[:3]
            yield f"process {name}", f"{cpu_ms / 1e3:.1f} s of a core, {memory_kb / 1024:.0f} MiB, {deaths} deaths"


def word(value: object) -> str:
    """Return a foreign value as one short line."""
    text = " ".join(str(value).split())
    return text if len(text) <= MAX_WORD else f"{text[: MAX_WORD - 3]}..."


def number(value: object) -> float | None:
    """Return a finite number, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    found = float(value)
    return found if abs(found) < 1e15 else None


def bounds(spec: Mapping[str, Any]) -> Bounds:
    """Return the rule's numbers of a specification; none if this version cannot read it."""
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
