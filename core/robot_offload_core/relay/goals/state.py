"""State of the ledger: goals of clients, the attempts at servers of both sides, and who may have them now."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.ports import CancelCode, GoalEntry, GoalStatus
from robot_offload_core.words.declared import ActionSpec
from robot_offload_core.words.holding import Holding

MAX_LIVE = 256
"""Most goals of all actions together that have not ended; a further one is refused."""
MAX_KEPT = 256
MAX_KEPT_BYTES = 16 * 1024 * 1024
"""Limit of the results kept for clients that have not asked yet; the oldest is dropped first."""
RETRY_S = 0.5
"""Time between two offers of a goal that was refused or ended while a side prepares, or after a change."""
MIRROR_S = 1.0
"""A mirror may end this long before the holder's attempt; if it ends earlier, its replica does something else."""
ASK_AGAIN_S = 0.020
"""Wait after a `NotHolder` while this relay's own view of the holder is unchanged."""


class Why(str, Enum):
    """Why the ledger itself ended or refused a goal."""

    GOAL_REFUSED = "GoalRefused"
    HOLDER_CHANGED = "HolderChanged"
    NO_ANSWER = "NoAnswer"
    NOT_ABLE = "HolderNotAble"
    FORGOTTEN = "GoalForgotten"
    CANCELED = "CanceledInChange"
    TOO_LARGE = "TooLarge"
    TOO_MANY = "TooManyGoals"
    KNOWN_ID = "GoalIdKnown"
    JOURNAL_FULL = "JournalFull"
    CLOUD_AWAY = "CloudAway"


class AttemptPhase(Enum):
    """State of an attempt at a server."""

    OFFERED = 1
    ACCEPTED = 2
    REFUSED = 3
    """By the server, or by the other relay before any server saw the offer."""
    ENDED = 4
    GONE = 5
    """The server has forgotten it, or its end can no longer be learned."""

    @property
    def live(self) -> bool:
        """The server may execute it now."""
        return self is AttemptPhase.OFFERED or self is AttemptPhase.ACCEPTED


@dataclass(frozen=True)
class Attempt:
    """One offer of a goal to one server, under an id that no server has seen.

    Attributes:
        id: the goal id at the server.
        site: side of the server.
        token: of the stay or preparation that it was made for.
        offered_s: when it was offered.
        rank: order of acceptance among all attempts; 0: not accepted.
        status: with which it ended.
        ended_s: when it ended.
        cancel: it is to end, whether or not its goal does.
        resume: its relay or this one was replaced; its result is to be requested again.
    """

    id: bytes
    site: Site
    token: Token
    offered_s: float
    phase: AttemptPhase = AttemptPhase.OFFERED
    rank: int = 0
    status: GoalStatus = GoalStatus.UNKNOWN
    ended_s: float = 0.0
    cancel: bool = False
    resume: bool = False


@dataclass(frozen=True)
class Goal:
    """A goal of a client.

    Attributes:
        id: the client's.
        action: public name.
        payload: the client's request.
        order: of arrival.
        stamp_ns: when it was accepted, for clients.
        caller: open request of a client that waits for the server's answer (`accept: Holder`); b"" otherwise.
        status: as the client sees it.
        result: the server's response; b"": a default one.
        why: reason if the ledger itself ended it.
        ended_s: when it ended; None while it lives.
        cancel: the client requested a cancel, which was granted.
        waiting: open requests for its result.
        attempts: all that may still run, and the newest of each side.
        need_s: since when the holder lacks a copy.
        able_s: since when the holder has been able to take one.
        moved: the need began with a change of the holder or a forgotten copy, so a refusal is not final.
        moves: changes of the holder that made the goal begin anew.
        retry_s: earliest next offer to the holder.
        copy_retry_s: earliest next offer to the candidate.
    """

    id: bytes
    action: str
    payload: bytes
    order: int
    stamp_ns: int
    caller: bytes = b""
    status: GoalStatus = GoalStatus.ACCEPTED
    result: bytes = b""
    why: Why | None = None
    ended_s: float | None = None
    cancel: bool = False
    waiting: tuple[bytes, ...] = ()
    attempts: tuple[Attempt, ...] = ()
    need_s: float = 0.0
    able_s: float | None = None
    moved: bool = False
    moves: int = 0
    retry_s: float = 0.0
    copy_retry_s: float = 0.0

    @property
    def entry(self) -> GoalEntry:
        """Return how status messages show the goal."""
        return GoalEntry(self.id, self.stamp_ns, self.status)

    @property
    def at_rest(self) -> bool:
        """Return whether the goal is kept only for its result: it has ended, and so has its one attempt, if any."""
        if self.ended_s is None or len(self.attempts) > 1:
            return False
        return not any(a.phase.live or a.resume for a in self.attempts)


@dataclass(frozen=True)
class View:
    """The situation at the moment of a decision.

    Attributes:
        holding: read from the collector's memory, now.
        candidate: the side that gets ready, and its token.
        able: sides whose CORE nodes are Active.
        up: (site, action) whose server is seen and whose node is Active.
        heard: the cloud's relay is heard.
        present: token under which nodes with placement Cloud act; None while no cloud is served.
        standby: newest token that the robot has named; messages to a standby carry it.
    """

    holding: Holding
    candidate: tuple[Site, Token] | None = None
    able: frozenset[Site] = frozenset()
    up: frozenset[tuple[Site, str]] = frozenset()
    heard: bool = False
    present: Token | None = None
    standby: Token | None = None


@dataclass(frozen=True)
class Ledger:
    """State of the ledger.

    Attributes:
        incarnation: of the relay; attempts of two incarnations have different ids.
        actions: served, by public name.
        holding: the newest stay that was taken into account.
        changed_s: when that stay began.
        goals: by the client's id, in the client's order; ended ones while their result is kept or an attempt may run.
        index: attempt id -> goal id.
        counter: of goals, attempts and acceptances.
    """

    incarnation: str
    actions: dict[str, ActionSpec]
    holding: Holding
    prepare_deadline_s: float = 5.0
    cancel_deadline_s: float = 2.0
    changed_s: float = float("-inf")
    goals: dict[bytes, Goal] = field(default_factory=dict)
    index: dict[bytes, bytes] = field(default_factory=dict)
    counter: int = 0


# -- events -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class GoalRequested:
    """A client sent a goal."""

    action: str
    caller: bytes
    goal_id: bytes
    payload: bytes
    stamp_ns: int


@dataclass(frozen=True)
class CancelRequested:
    """A client asks to cancel: one goal, those up to a time, all, or a mixture (action_msgs/srv/CancelGoal)."""

    action: str
    caller: bytes
    goal_id: bytes
    stamp_ns: int


@dataclass(frozen=True)
class ResultRequested:
    """A client asks for a result."""

    action: str
    caller: bytes
    goal_id: bytes


class OfferAnswer(Enum):
    """The answer to an offer."""

    ACCEPTED = 1
    REFUSED = 2
    NOT_HOLDER = 3
    """The other side's relay refused the offer before any server saw it."""


@dataclass(frozen=True)
class OfferAnswered:
    """An offer was answered."""

    attempt: bytes
    answer: OfferAnswer


@dataclass(frozen=True)
class Ended:
    """An attempt has ended. `under_lease`: the side was allowed to act under the attempt's token at that moment."""

    attempt: bytes
    status: GoalStatus
    result: bytes
    under_lease: bool = True


@dataclass(frozen=True)
class Gone:
    """The server has forgotten the attempt."""

    attempt: bytes


@dataclass(frozen=True)
class Replaced:
    """The cloud's relay, or this one (`site` None), is a new process: running attempts are queried again."""

    site: Site | None = None


@dataclass(frozen=True)
class Looked:
    """Time has passed, or the view changed."""


Event = GoalRequested | CancelRequested | ResultRequested | OfferAnswered | Ended | Gone | Replaced | Looked

# -- commands ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AnswerGoal:
    """To a client: its goal is accepted or refused."""

    action: str
    caller: bytes
    accepted: bool
    stamp_ns: int
    why: Why | None = None


@dataclass(frozen=True)
class AnswerCancel:
    """To a client: the answer to its cancel."""

    action: str
    caller: bytes
    code: CancelCode
    goals: tuple[GoalEntry, ...]


@dataclass(frozen=True)
class AnswerResult:
    """To a client: a result."""

    action: str
    caller: bytes
    status: GoalStatus
    payload: bytes


@dataclass(frozen=True)
class PublishStatus:
    """The status of all goals of an action."""

    action: str
    goals: tuple[GoalEntry, ...]


@dataclass(frozen=True)
class Offer:
    """To a side's server. The payload is the client's, but with the attempt's id as goal id. `mirror`: to a standby."""

    site: Site
    action: str
    attempt: bytes
    payload: bytes
    token: Token
    mirror: bool = False


@dataclass(frozen=True)
class Cancel:
    """To a side: end the attempt. The side's relay asks its server until it has ended."""

    site: Site
    action: str
    attempt: bytes


@dataclass(frozen=True)
class Resume:
    """To a side: continue the attempt under this token, or as a mirror, and report its state again."""

    site: Site
    action: str
    attempt: bytes
    token: Token
    mirror: bool = False


@dataclass(frozen=True)
class GoalClosed:
    """For log and diagnostics: a goal has ended; `why` is set if the ledger itself ended it."""

    action: str
    goal_id: bytes
    status: GoalStatus
    why: Why | None


Command = AnswerGoal | AnswerCancel | AnswerResult | PublishStatus | Offer | Cancel | Resume | GoalClosed
