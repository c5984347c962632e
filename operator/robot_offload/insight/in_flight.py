"""Goals and calls in flight, restarts and the age of handed-over state, as both agents report them. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from robot_offload.api.agent_state import AgentState
from robot_offload.api.side_numbers import IN_FLIGHT, SideNumbers

NOTHING_KNOWN: Final = "not known: no report of the robot in the last 5 s"
"""Only the robot knows: clients talk to its relay."""


def goals(state: AgentState) -> str:
    """Return the goals of each action: `/go 1 executing, 1 waiting, 3 restarts`; empty: no action is declared."""
    robot = state.robot
    if robot is None:
        return NOTHING_KNOWN
    found = [f"{name} {goals_of(counts)}" for name, counts in robot.actions]
    return "; ".join([*found, *_used(robot.used_goals)])


def calls(state: AgentState) -> str:
    """Return the open calls of each service: `/plan 2 open`; empty: no service is declared."""
    robot = state.robot
    if robot is None:
        return NOTHING_KNOWN
    found = [f"{name} {count or 'none'} open" for name, count in robot.services]
    return "; ".join([*found, *_used(robot.used_calls)])


def state_ages(state: AgentState) -> str:
    """Return the age of each entry when a side last resumed from it: `pose 85 ms in the cloud`; empty: none yet."""
    return ", ".join(
        [
            *(f"{name} {age_ms} ms in the cloud" for name, age_ms in state.state_ages_ms),
            *(f"{name} {age_ms} ms on the robot" for name, age_ms in _of_robot(state.robot)),
        ]
    )


def sentences(state: AgentState) -> Iterable[str]:
    """Yield a sentence for each thing in flight or handed over."""
    robot = state.robot
    if robot is not None:
        for name, (executing, waiting, restarts) in robot.actions:
            if executing or waiting or restarts:
                yield f"Goals of {name} now: {goals_of((executing, waiting, restarts))}."
        for name, count in robot.services:
            if count:
                yield f"Calls of {name} that wait for their answer: {count}."
        for what, used in (("Goals", robot.used_goals), ("Calls", robot.used_calls)):
            if used:
                yield f"{what} of the duplicated nodes at servers outside, not ended yet: {used}."
    ages = state_ages(state)
    if ages:
        yield f"How old the state was that a side last went on with: {ages}."


def plain(state: AgentState | None) -> dict[str, Any]:
    """Return the same for programs; None stands for unknown."""
    robot = state.robot if state is not None else None
    return {
        "goals": None
        if robot is None
        else [{"action": name, **dict(zip(IN_FLIGHT, counts, strict=True))} for name, counts in robot.actions],
        "calls": None if robot is None else [{"service": name, "open": count} for name, count in robot.services],
        "used": None if robot is None else {"goals": robot.used_goals, "calls": robot.used_calls},
        "stateAgesMs": None
        if state is None
        else {"cloud": dict(state.state_ages_ms), "robot": None if robot is None else dict(robot.states)},
    }


def goals_of(counts: tuple[int, ...]) -> str:
    """Return the goals of one action: executing, waiting, restarted."""
    executing, waiting, restarts = counts
    words = [f"{executing} executing", f"{waiting} waiting"] if executing or waiting else ["none in flight"]
    if restarts:
        words.append(f"{restarts} restart{'s' if restarts > 1 else ''}")
    return ", ".join(words)


def _used(count: int | None) -> list[str]:
    return [f"{count} at servers outside"] if count else []


def _of_robot(robot: SideNumbers | None) -> tuple[tuple[str, int], ...]:
    return robot.states if robot is not None else ()
