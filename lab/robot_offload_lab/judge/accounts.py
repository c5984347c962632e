"""What an application reports about its goals, calls and state, as records of a run. Pure.

A client's account (std_msgs/String with JSON) is `{"goals": [...], "calls": {...}}`: what one client of an action and a
service on the robot has received so far. The account of a node with state is `{"node": NAME, "restored_age_s": AGE,
"at_s": TIME}`: how old its initial state was (null when it began clean), and the system time of the report.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from robot_offload_lab.judge.recording import Calls, Errand, Restored, Site
from robot_offload_lab.judge.translate import site_of


@dataclass(frozen=True)
class Topics:
    """The topics on which an application publishes its accounts; an empty one: it does not.

    Attributes:
        state: account of its drive, see `translate.drive`.
        account: account of a client's goals and calls.
        restored: account of a node with state.
    """

    state: str = ""
    account: str = ""
    restored: str = ""


@dataclass(frozen=True)
class Account:
    """What a client has received so far."""

    goals: tuple[Errand, ...]
    calls: Calls

    def records(self) -> Iterator[Errand | Calls]:
        """Yield everything, unchanged records included."""
        yield from self.goals
        yield self.calls


def account(t_s: float, text: str) -> Account | None:
    """Return the account of a client as received at `t_s`; None when the text is not one."""
    try:
        said = json.loads(text)
        return Account(tuple(_errand(t_s, goal) for goal in said["goals"]), _calls(t_s, said["calls"]))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


def _errand(t_s: float, goal: Any) -> Errand:
    return Errand(
        t_s=t_s,
        goal=int(goal["goal"]),
        ending=str(goal["ending"]),
        accepted_ms=_number(goal["accepted_ms"]),
        feedback=int(goal["feedback"]),
        servers=int(goal["servers"]),
        backwards=int(goal["backwards"]),
        silence_ms=float(goal["silence_ms"]),
        results=int(goal["results"]),
        x_m=_number(goal["x_m"]),
        y_m=_number(goal["y_m"]),
    )


def _calls(t_s: float, calls: Any) -> Calls:
    counts = {name: int(calls[name]) for name in ("asked", "answered", "failed", "unanswered")}
    return Calls(t_s, longest_ms=float(calls["longest_ms"]), **counts)


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


def restored(t_s: float, text: str, steady: Callable[[float], float]) -> Restored | None:
    """Return the account of a node with state as received at `t_s`; None when the text is not one.

    Args:
        t_s: on the steady clock.
        text: the message's.
        steady: converts system time, in which the account states its time, to the steady clock.
    """
    try:
        said = json.loads(text)
        node, made_s = str(said["node"]), _number(said.get("at_s"))
        site: Site = site_of(node)
        age_s = _number(said["restored_age_s"])
        return Restored(t_s, node, site, age_s, None if made_s is None else steady(made_s))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
