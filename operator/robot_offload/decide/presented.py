"""The certificate with which the robot dials: what is known of it, and whether a person must act."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_offload.api.agent_state import AgentState
from robot_offload.decide.renewal import Answer
from robot_offload.decide.verdicts import Verdict, no, unknown, yes


@dataclass(frozen=True, slots=True)
class Presented:
    """The certificate with which the robot dials.

    Attributes:
        serial: of the certificate, hexadecimal.
        not_after: its end.
        stuck: why the robot cannot get another one, as (reason, message); None: it can, or need not yet.
    """

    serial: str
    not_after: datetime.datetime
    stuck: tuple[str, str] | None = None


def presented(state: AgentState | None, before: Mapping[str, Any]) -> Presented | None:
    """Return the robot's present or last report; None: it never sent one.

    Args:
        state: of the cloud's agent.
        before: `status.certificates.robot` as it was last written; empty: never.
    """
    told = state.certificate if state is not None else None
    if told is not None and told.serial and told.not_after:
        serial, end = told.serial, told.not_after
    else:
        serial, end = before.get("serial") or "", before.get("notAfter") or ""
    try:
        stuck = (told.reason, told.message) if told is not None and told.reason else None
        return Presented(serial, datetime.datetime.fromisoformat(end), stuck) if serial else None
    except ValueError:
        return None


def verdict(
    found: Presented | None, answer: Answer | None, margin: datetime.timedelta, now: datetime.datetime
) -> Verdict:
    """Return whether the robot's certificate is good for a while (condition CertificateCurrent).

    Args:
        found: the certificate with which the robot dials.
        answer: to its present request for another one; None: there is no request.
        margin: `certificates.renewBefore`; once half of it has passed, the robot no longer renews by itself.
        now: our wall clock.
    """
    if found is None:
        return unknown("NotReported", "The robot has not said which certificate it uses; its bundle's is in the status")
    day = f"{found.not_after:%Y-%m-%d %H:%M} UTC"
    if found.not_after <= now:
        return no("Expired", f"The robot's certificate ended on {day}; write its bundle again")
    stuck = found.stuck
    if answer is not None:
        stuck = None if answer.certificate else (answer.reason, answer.message)
    if stuck is not None:
        return no(stuck[0], f"{stuck[1]}. The robot's certificate ends on {day}")
    if found.not_after - margin / 2 <= now:
        return no("Expiring", f"The robot's certificate ends on {day}; let it connect, or write its bundle")
    return yes("Current", f"The robot's certificate ends on {day}")


def recheck_s(found: Presented | None, margin: datetime.timedelta, now: datetime.datetime) -> float | None:
    """Return the seconds after which the verdict changes without an event; None: never."""
    if found is None:
        return None
    ahead = [(moment - now).total_seconds() for moment in (found.not_after - margin / 2, found.not_after)]
    return min((after_s + 1.0 for after_s in ahead if after_s > 0), default=None)
