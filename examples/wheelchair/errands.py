"""What a client hears of its goals, one after the other; `robot-offload demo` shows it. Used by `passenger`."""

import json
import time
from dataclasses import asdict, dataclass, field

from action_msgs.msg import GoalStatus

ENDINGS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_CANCELED: "canceled",
    GoalStatus.STATUS_ABORTED: "aborted",
}


@dataclass
class Errand:
    """What became of one goal.

    Attributes:
        goal: its number, from 1.
        accepted_ms: how long its acceptance took; None while it is not accepted.
        feedback: messages.
        servers: how many times another process went on with it, the first one included.
        backwards: feedback that came out of order.
        silence_ms: longest silence of its feedback since the last account.
        results: how many came; `ending` is the first: succeeded, canceled, aborted, or rejected.
        x_m, y_m: where its server believes to be.
    """

    goal: int
    accepted_ms: float | None = None
    feedback: int = 0
    servers: int = 0
    backwards: int = 0
    silence_ms: float = 0.0
    results: int = 0
    ending: str = ""
    x_m: float | None = None
    y_m: float | None = None


@dataclass
class Calls:
    """What became of the calls of `how_far`: answers with and without success, none at all, the longest wait."""

    asked: int = 0
    answered: int = 0
    failed: int = 0
    unanswered: int = 0
    longest_ms: float = 0.0


@dataclass
class Account:
    """Everything so far, as it is published."""

    goals: list[Errand] = field(default_factory=list)
    calls: Calls = field(default_factory=Calls)


class Errands:
    """Keeps the account of a client that sends one goal at a time.

    Attributes:
        account: see Account.
    """

    def __init__(self) -> None:
        self.account = Account()
        self._sent_s = self._heard_s = 0.0
        self._last = (0, 0)

    @property
    def present(self) -> Errand | None:
        """The goal under way."""
        goals = self.account.goals
        return goals[-1] if goals and not goals[-1].ending else None

    def begin(self) -> Errand:
        """Note that a goal is being sent."""
        errand = Errand(len(self.account.goals) + 1)
        self.account.goals.append(errand)
        self._sent_s, self._last = time.monotonic(), (0, 0)
        return errand

    def answered(self, errand: Errand, *, accepted: bool) -> None:
        """Note the answer to a goal."""
        if not accepted:
            errand.ending = "rejected"
            return
        self._heard_s = time.monotonic()
        errand.accepted_ms = round((self._heard_s - self._sent_s) * 1e3, 1)

    def heard(self, errand: Errand, process: int, tick: int, x_m: float, y_m: float) -> None:
        """Note feedback: of which process, the how manieth there, and where the server believes to be."""
        last_process, last_tick = self._last
        errand.servers += process != last_process
        errand.backwards += process == last_process and tick <= last_tick
        self._last = (process, tick)
        errand.feedback += 1
        errand.x_m, errand.y_m = x_m, y_m
        self._note_silence(errand)
        self._heard_s = time.monotonic()

    def ended(self, errand: Errand, status: int) -> None:
        """Note a result."""
        errand.results += 1
        errand.ending = errand.ending or ENDINGS.get(status, f"status {status}")

    def text(self) -> str:
        """Return the account as JSON, and count silence anew."""
        errand = self.present
        if errand is not None:
            self._note_silence(errand)
        text = json.dumps(asdict(self.account))
        if errand is not None:
            errand.silence_ms = 0.0
        return text

    def _note_silence(self, errand: Errand) -> None:
        if errand.accepted_ms is not None:
            errand.silence_ms = max(errand.silence_ms, round((time.monotonic() - self._heard_s) * 1e3, 1))
