"""What an application says of its goals, calls and state, as records of a run. Pure.

The account of a client (std_msgs/String with JSON) is `{"goals": [...], "calls": {...}}`: what one client of an action
and of a service on the robot has heard so far. The account of a node with state is `{"node": NAME, "restored_age_s":
AGE, "at_s": TIME}`: how old the state was with which it began, null when it began clean, and when it says so (system
clock).
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
    """Where an application gives its accounts; empty where it does not.

    Attributes:
        state: of its drive, see `translate.drive`.
        account: of a client's goals and calls.
        restored: of a node with state.
    """

    state: str = ""
    account: str = ""
    restored: str = ""


@dataclass(frozen=True)
class Account:
    """What a client has heard so far."""

    goals: tuple[Errand, ...]
    calls: Calls

    def records(self) -> Iterator[Errand | Calls]:
        """Yield everything; what is the same as before is for the reader to see."""
        yield from self.goals
        yield self.calls


def account(t_s: float, text: str) -> Account | None:
    """Return the account of a client as it was heard at `t_s`; None when it is none."""
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
    """Return the account of a node with state as it was heard at `t_s`; None when it is none.

    Args:
        t_s: on the steady clock.
        text: the message's.
        steady: returns a moment of the system clock, in which the account gives its time, on the steady clock.
    """
    try:
        said = json.loads(text)
        node, made_s = str(said["node"]), _number(said.get("at_s"))
        site: Site = site_of(node)
        age_s = _number(said["restored_age_s"])
        return Restored(t_s, node, site, age_s, None if made_s is None else steady(made_s))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
