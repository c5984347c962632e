"""Calls of the group at services outside: the holder's pass, a preparing side's wait, a standby's are refused.

Decided on the robot for both sides, because the collector and the servers are there.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.state import View
from robot_offload_core.words.declared import UsedService


class Admission(Enum):
    """Whether a call at a used name passes."""

    ADMIT = 1
    WAIT = 2
    REFUSE = 3


def admit(view: View, effects: Site | None, site: Site, token: Token | None, of_cloud: bool = False) -> Admission:
    """Return what becomes of a call of `site`.

    Args:
        view: the holder, by the collector's memory.
        effects: the side whose calls control admits; None: neither's.
        site: whose replica calls.
        token: under which a cloud's call was made; None on the robot.
        of_cloud: the caller has placement Cloud: it acts by presence, whichever side holds.
    """
    if of_cloud and site is Site.CLOUD:
        return Admission.ADMIT if token is not None and token == view.present else Admission.REFUSE
    ours = site is Site.ROBOT or token == view.holding.token
    if view.holding.site is site and ours:
        return Admission.ADMIT if effects is site else Admission.WAIT
    candidate = view.candidate
    if candidate is not None and candidate[0] is site and (site is Site.ROBOT or token == candidate[1]):
        return Admission.WAIT
    return Admission.REFUSE


@dataclass
class UsedCall:
    """A call of a replica.

    Attributes:
        caller: on the robot.
        key: of the cloud's relay.
        number: at the server; 0: the call waits.
    """

    spec: UsedService
    site: Site
    token: Token | None
    payload: bytes
    until_s: float
    caller: bytes = b""
    key: int = 0
    number: int = 0


class Verdicts(Enum):
    """The decision on a call."""

    CALL = 1
    REFUSED = 2
    TIMEOUT = 3


class UsedCalls:
    """The calls at used services of both sides, on the robot."""

    def __init__(self, services: tuple[UsedService, ...]) -> None:
        self.services = {spec.name: spec for spec in services}
        self.calls: list[UsedCall] = []

    def settle(self, view: View, effects: Site | None, now_s: float) -> list[tuple[UsedCall, Verdicts]]:
        """Return the calls that are decided now; those to be made are remembered until they are answered."""
        decided: list[tuple[UsedCall, Verdicts]] = []
        for call in list(self.calls):
            admission = (
                Admission.ADMIT if call.number else admit(view, effects, call.site, call.token, call.spec.of_cloud)
            )
            if admission is Admission.REFUSE:
                self.calls.remove(call)
                decided.append((call, Verdicts.REFUSED))
            elif now_s >= call.until_s:
                self.calls.remove(call)
                decided.append((call, Verdicts.TIMEOUT))
            elif admission is Admission.ADMIT and not call.number:
                decided.append((call, Verdicts.CALL))
        return decided

    def answered(self, number: int) -> UsedCall | None:
        """Close and return the call that an answer is for; None if no caller waits any more."""
        call = next((c for c in self.calls if c.number == number), None)
        if call is not None:
            self.calls.remove(call)
        return call

    def due_s(self) -> float:
        """Return when a call is given up."""
        return min((call.until_s for call in self.calls), default=float("inf"))
