"""One relay's work at the servers that it calls: attempts offered, cancelled until they end, results requested.

Knows nothing of clients and of the holder. The robot's relay has one for its own replica and one for servers outside
the group, the cloud's relay one for its replica.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from robot_offload_core.fence.token import Token
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalStatus, RelayPorts
from robot_offload_core.relay.goals.wire_ids import with_goal_id

CANCEL_AGAIN_S = 0.5
"""A server that did not end an attempt is asked again after this time."""
SEEN_WITHIN_S = 5.0
"""A server that is not in the graph this long after an attempt was resumed is gone; discovery may take seconds."""
MAX_DONE = 1024
"""Ids of ended attempts that are remembered, so that a late word does not begin one of them again."""
MAX_RESULTS_BYTES = 16 * 1024 * 1024
"""Limit of the results kept for a restarted relay that asks for them."""


@dataclass
class Run:
    """An attempt at a server.

    Attributes:
        action: public name.
        token: under which it runs.
        accepted: the server has accepted it, or that is unknown and its result is requested.
        cancel: it is to end.
        cancel_due_s: when the server is asked (again) to end it.
        sequence: number of its newest feedback.
        named_until_s: until when it may run without a lease, as a mirror; -inf: it is not one.
        unasked_until_s: deadline to find the server of a resumed attempt and request its result; None: no deadline.
    """

    action: str
    token: Token
    accepted: bool = False
    cancel: bool = False
    cancel_due_s: float = float("inf")
    sequence: int = 0
    unasked_until_s: float | None = None
    named_until_s: float = float("-inf")


@dataclass(frozen=True)
class OfferAnswered:
    """A server has accepted or refused an attempt."""

    attempt: bytes
    accepted: bool


@dataclass(frozen=True)
class RunEnded:
    """A server has reported how an attempt ended. `leased`: this side was allowed to act under its token then."""

    attempt: bytes
    status: GoalStatus
    result: bytes
    leased: bool = True


@dataclass(frozen=True)
class RunGone:
    """The server no longer knows the attempt, or is gone itself."""

    attempt: bytes


Outcome = OfferAnswered | RunEnded | RunGone


class Executor:
    """The attempts at the servers of one face.

    Attributes:
        runs: attempts that may be executed now, by id.
        done: the newest attempts that may not, and how they ended if known.
        seen: (action) -> endpoints of the server that is in the graph.
    """

    def __init__(self, face: Face, ports: RelayPorts, report: Callable[[Outcome], None]) -> None:
        self.face = face
        self.ports = ports
        self.report = report
        self.runs: dict[bytes, Run] = {}
        self.done: OrderedDict[bytes, RunEnded | None] = OrderedDict()
        self.seen: dict[str, str] = {}

    # -- orders -------------------------------------------------------------------------------------------------------

    def offer(self, action: str, attempt: bytes, payload: bytes, token: Token, *, mirror: bool = False) -> None:
        """Offer a goal under an id; a known id is never offered again."""
        if attempt in self.runs or attempt in self.done:
            return
        self.runs[attempt] = Run(action, token, named_until_s=_named(mirror))
        self.ports.offer(self.face, action, with_goal_id(payload, attempt))

    def cancel(self, attempt: bytes) -> None:
        """End an attempt, now or when it is accepted; ask again until it has ended."""
        run = self.runs.get(attempt)
        if run is None:
            self._finish(attempt)
        elif not run.cancel:
            run.cancel, run.cancel_due_s = True, self.ports.now_s()
            self._ask_to_cancel(attempt, run)

    def resume(self, action: str, attempt: bytes, token: Token, *, mirror: bool = False) -> None:
        """Take over an attempt of a predecessor or of an earlier epoch; the server reports whether it knows it."""
        if attempt in self.done:
            self.report(self.done[attempt] or RunGone(attempt))
            return
        run = self.runs.get(attempt)
        if run is not None:
            run.token, run.named_until_s = token, _named(mirror)
            if run.accepted:
                self.report(OfferAnswered(attempt, True))
            return
        run = self.runs[attempt] = Run(action, token, accepted=True, named_until_s=_named(mirror))
        run.unasked_until_s = self.ports.now_s() + SEEN_WITHIN_S
        self._ask_for_result(attempt, run)

    # -- the servers --------------------------------------------------------------------------------------------------

    def offer_answered(self, attempt: bytes, accepted: bool) -> None:
        """Take the answer to an offer."""
        run = self.runs.get(attempt)
        if run is None or run.accepted:
            return
        if not accepted:
            self._finish(attempt)
            self.report(OfferAnswered(attempt, False))
            return
        run.accepted = True
        self.ports.ask_result(self.face, run.action, attempt)
        self.report(OfferAnswered(attempt, True))
        self._ask_to_cancel(attempt, run)

    def cancel_answered(self, attempt: bytes, code: CancelCode) -> None:
        """Take the answer to a cancel: a server that does not know the attempt has forgotten it."""
        if code is CancelCode.UNKNOWN_GOAL and attempt in self.runs:
            self._gone(attempt)

    def result_arrived(self, attempt: bytes, status: GoalStatus, result: bytes, leased: bool = True) -> None:
        """Take a result; status 0: the server does not know the attempt."""
        if attempt not in self.runs:
            return
        if status is GoalStatus.UNKNOWN:
            self._gone(attempt)
            return
        if status.ended:
            ended = RunEnded(attempt, status, result, leased)
            self._finish(attempt, ended)
            self.report(ended)

    def feedback_arrived(self, attempt: bytes) -> int:
        """Count a feedback message; return its sequence number, or 0 if the attempt is not running here."""
        run = self.runs.get(attempt)
        if run is None:
            return 0
        run.sequence += 1
        return run.sequence

    def servers_seen(self, seen: dict[str, str]) -> None:
        """Take the servers in the graph. One that left or was replaced has forgotten its attempts (rule 10)."""
        before, self.seen = self.seen, dict(seen)
        changed = {name for name, endpoints in before.items() if seen.get(name) != endpoints}
        for attempt in [a for a, run in self.runs.items() if run.action in changed]:
            self._gone(attempt)
        for attempt, run in self.runs.items():
            self._ask_for_result(attempt, run)

    # -- time ---------------------------------------------------------------------------------------------------------

    def turn(self) -> None:
        """Repeat cancels that are due; give up servers that do not come back."""
        now_s = self.ports.now_s()
        for attempt, run in list(self.runs.items()):
            if run.cancel_due_s <= now_s:
                self._ask_to_cancel(attempt, run)
            if run.unasked_until_s is not None and now_s >= run.unasked_until_s:
                self._gone(attempt)

    def due_s(self) -> float:
        """Return when `turn` has something to do."""
        cancels = [run.cancel_due_s for run in self.runs.values() if run.accepted]
        unasked = [run.unasked_until_s for run in self.runs.values() if run.unasked_until_s is not None]
        return min(cancels + unasked, default=float("inf"))

    # -- inside -------------------------------------------------------------------------------------------------------

    def _ask_to_cancel(self, attempt: bytes, run: Run) -> None:
        if run.cancel and run.accepted:
            run.cancel_due_s = self.ports.now_s() + CANCEL_AGAIN_S
            self.ports.cancel(self.face, run.action, attempt)

    def _gone(self, attempt: bytes) -> None:
        self._finish(attempt)
        self.report(RunGone(attempt))

    def _ask_for_result(self, attempt: bytes, run: Run) -> None:
        if run.unasked_until_s is not None and run.action in self.seen:
            run.unasked_until_s = None
            self.ports.ask_result(self.face, run.action, attempt)

    def _finish(self, attempt: bytes, ended: RunEnded | None = None) -> None:
        self.runs.pop(attempt, None)
        self.done[attempt] = ended or self.done.get(attempt)
        size = sum(len(done.result) for done in self.done.values() if done is not None)
        while len(self.done) > MAX_DONE or size > MAX_RESULTS_BYTES:
            _, oldest = self.done.popitem(last=False)
            size -= len(oldest.result) if oldest is not None else 0


def _named(mirror: bool) -> float:
    return float("inf") if mirror else float("-inf")
