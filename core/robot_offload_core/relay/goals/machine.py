"""The ledger's machine: `step(ledger, event, view, now_s) -> (ledger, commands)`.

An event only records what it reports. `attempts.settle` then compares the attempts with what they must be and orders
the difference. So words of the two sides may arrive in any order, or twice.
"""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals import attempts
from robot_offload_core.relay.goals.ports import CancelCode, GoalStatus
from robot_offload_core.relay.goals.questions import meant, overtaken, there
from robot_offload_core.relay.goals.state import (
    ASK_AGAIN_S,
    MAX_LIVE,
    RETRY_S,
    AnswerCancel,
    AnswerGoal,
    AnswerResult,
    Attempt,
    AttemptPhase,
    CancelRequested,
    Command,
    Ended,
    Event,
    Goal,
    GoalRequested,
    Gone,
    Ledger,
    Looked,
    OfferAnswer,
    OfferAnswered,
    Replaced,
    ResultRequested,
    View,
    Why,
)
from robot_offload_core.relay.goals.wire_ids import NO_GOAL
from robot_offload_core.relay.goals.work import Work
from robot_offload_core.words.checks import require
from robot_offload_core.words.declared import Accept, ActionSpec
from robot_offload_core.words.events import assert_never
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.replace import replace


def start(
    incarnation: str,
    actions: tuple[ActionSpec, ...],
    holding: Holding,
    prepare_deadline_s: float = 5.0,
    cancel_deadline_s: float = 2.0,
) -> Ledger:
    """Return a ledger without goals."""
    table = {spec.name: spec for spec in actions}
    return Ledger(incarnation, table, holding, prepare_deadline_s, cancel_deadline_s)


def step(ledger: Ledger, event: Event, view: View, now_s: float) -> tuple[Ledger, list[Command]]:
    """Process one event; return the next state and the commands."""
    work = Work(ledger, view, now_s)
    _notice_change(work)
    match event:
        case GoalRequested():
            _goal_requested(work, event)
        case CancelRequested():
            _cancel_requested(work, event)
        case ResultRequested():
            _result_requested(work, event)
        case OfferAnswered():
            _answered(work, event)
        case Ended():
            _ended(work, event)
        case Gone():
            _gone(work, event)
        case Replaced():
            _replaced(work, event.site)
        case Looked():
            pass
        case _:
            assert_never(event)
    attempts.settle(work)
    after = work.done()
    check(ledger, after, event)
    return after, work.commands


def check(before: Ledger, after: Ledger, event: object) -> None:
    """Raise InvariantError if the step from `before` to `after` broke an invariant."""
    for goal_id, goal in after.goals.items():
        was = before.goals.get(goal_id)
        if was is goal:
            continue
        ended = was is not None and was.ended_s is not None
        require(
            "ledger",
            event,
            (not ended or (was is not None and goal.status is was.status), "a goal has two results"),
            (goal.ended_s is None or goal.status.ended, "a goal ended without a result"),
            (goal.ended_s is None or not goal.waiting, "a goal has ended and somebody still waits"),
            (goal.cancel or goal.status is not GoalStatus.CANCELED, "CANCELED, and no client asked for it"),
        )


# -- the holder -------------------------------------------------------------------------------------------------------


def _notice_change(work: Work) -> None:
    """Begin a new stay: continue goals that waited, end goals that must not be executed twice (rules 3 and 7)."""
    holding = work.view.holding
    known = work.ledger.holding
    if (holding.site, holding.stay) == (known.site, known.stay):
        work.holding = holding
        return
    work.holding, work.changed_s = holding, work.now_s
    for goal in work.live():
        if work.spec(goal).of_cloud:
            continue
        offered = any(a.phase is not AttemptPhase.REFUSED for a in goal.attempts)
        if goal.cancel:
            work.end(goal, GoalStatus.CANCELED, why=Why.CANCELED)
        elif offered and not work.spec(goal).on_switch.resends:
            work.end(goal, GoalStatus.ABORTED, why=Why.HOLDER_CHANGED)
        else:
            moves = goal.moves + offered
            work.put(replace(goal, need_s=work.now_s, able_s=None, moved=True, moves=moves, retry_s=0.0))


def _replaced(work: Work, site: Site | None) -> None:
    for goal in work.all():
        attempts = tuple(
            replace(a, resume=True) if a.phase.live and site in (None, a.site) else a for a in goal.attempts
        )
        if attempts != goal.attempts:
            work.put(replace(goal, attempts=attempts))


# -- clients ----------------------------------------------------------------------------------------------------------


def _goal_requested(work: Work, event: GoalRequested) -> None:
    spec = work.ledger.actions[event.action]
    why = None
    if event.goal_id in work.goals:
        why = Why.KNOWN_ID
    elif sum(1 for _ in work.live()) >= MAX_LIVE:
        why = Why.TOO_MANY
    elif spec.of_cloud and not there(work.view, spec.name):
        why = Why.CLOUD_AWAY
    if why is not None:
        work.commands.append(AnswerGoal(event.action, event.caller, False, 0, why))
        return
    at_once = spec.accept is Accept.RELAY
    goal = Goal(
        event.goal_id, event.action, event.payload, work.count(), event.stamp_ns,
        caller=b"" if at_once else event.caller, need_s=work.now_s,
    )  # fmt: skip
    work.put(goal)
    if at_once:
        work.commands.append(AnswerGoal(event.action, event.caller, True, event.stamp_ns))
        work.shown.add(event.action)


def _cancel_requested(work: Work, event: CancelRequested) -> None:
    """Answer from the ledger at once, goal by goal (rule 7)."""
    known = work.goals.get(event.goal_id)
    named = known if known is not None and known.action == event.action and not known.caller else None
    chosen = [
        goal
        for goal in work.live()
        if goal.action == event.action and not goal.caller and meant(event, goal.id, goal.stamp_ns)
    ]
    code = CancelCode.NONE
    if event.goal_id != NO_GOAL and not chosen:
        code = CancelCode.UNKNOWN_GOAL if named is None else CancelCode.TERMINATED
    for goal in chosen:
        work.put(replace(goal, cancel=True, status=GoalStatus.CANCELING))
    entries = tuple(work.goals[goal.id].entry for goal in chosen)
    work.commands.append(AnswerCancel(event.action, event.caller, code, entries))
    work.shown.add(event.action)


def _result_requested(work: Work, event: ResultRequested) -> None:
    goal = work.goals.get(event.goal_id)
    if goal is None or goal.action != event.action or goal.caller:
        work.commands.append(AnswerResult(event.action, event.caller, GoalStatus.UNKNOWN, b""))
    elif goal.ended_s is not None:
        work.commands.append(AnswerResult(event.action, event.caller, goal.status, goal.result))
    elif event.caller not in goal.waiting:
        work.put(replace(goal, waiting=(*goal.waiting, event.caller)))


# -- servers ----------------------------------------------------------------------------------------------------------


def _answered(work: Work, event: OfferAnswered) -> None:
    goal, attempt = work.find(event.attempt)
    if goal is None or attempt is None or attempt.phase is not AttemptPhase.OFFERED:
        return
    if event.answer is OfferAnswer.ACCEPTED:
        _accepted(work, goal, attempt)
        return
    wait_s = ASK_AGAIN_S if event.answer is OfferAnswer.NOT_HOLDER else RETRY_S
    goal = work.attempt(goal, replace(attempt, phase=AttemptPhase.REFUSED, ended_s=work.now_s))
    if not _counts(work, goal, attempt):
        work.put(replace(goal, copy_retry_s=work.now_s + wait_s))
    elif event.answer is OfferAnswer.NOT_HOLDER or goal.moved:
        work.put(replace(goal, retry_s=work.now_s + wait_s))
    elif goal.ended_s is None:
        work.end(goal, GoalStatus.ABORTED, why=Why.GOAL_REFUSED)


def _accepted(work: Work, goal: Goal, attempt: Attempt) -> None:
    goal = work.attempt(goal, replace(attempt, phase=AttemptPhase.ACCEPTED, rank=work.count()))
    if goal.ended_s is not None or not _counts(work, goal, attempt):
        return
    status = GoalStatus.CANCELING if goal.cancel else GoalStatus.EXECUTING
    caller, goal = goal.caller, replace(goal, status=status, caller=b"")
    work.put(goal)
    work.shown.add(goal.action)
    if caller:
        work.commands.append(AnswerGoal(goal.action, caller, True, goal.stamp_ns))


def _counts(work: Work, goal: Goal, attempt: Attempt) -> bool:
    """Return whether an attempt is the holder's copy: on its side, under its token, not cancelled by this relay."""
    site, token = work.acts(goal)
    if attempt.site is not site or attempt.cancel:
        return False
    return attempt.site is Site.ROBOT or attempt.token == token


def _ended(work: Work, event: Ended) -> None:
    goal, attempt = work.find(event.attempt)
    if goal is None or attempt is None or not attempt.phase.live:
        return
    if event.status is GoalStatus.UNKNOWN:
        _gone(work, Gone(event.attempt))
        return
    counts = _counts(work, goal, attempt) or (goal.cancel and attempt.site is work.acts(goal)[0])
    goal = work.attempt(goal, replace(attempt, phase=AttemptPhase.ENDED, status=event.status, ended_s=work.now_s))
    if goal.ended_s is not None:
        return
    if event.status is GoalStatus.SUCCEEDED and (counts or _of_earlier_stay(work, attempt, event)):
        work.end(goal, event.status, event.result)
    elif not counts:
        work.put(replace(goal, copy_retry_s=work.now_s + RETRY_S))
    elif not event.under_lease and not goal.cancel:
        _need_another(work, goal, Why.HOLDER_CHANGED)
    elif goal.cancel or not _early(work, goal) or overtaken(work.seen(), goal, attempt):
        work.end(goal, *unasked(goal, event))
    else:
        work.put(replace(goal, retry_s=work.now_s + RETRY_S))


def unasked(goal: Goal, event: Ended) -> tuple[GoalStatus, bytes]:
    """Return status and result for the client: never CANCELED when no client asked for that (invariant 6e)."""
    if event.status is GoalStatus.CANCELED and not goal.cancel:
        return GoalStatus.ABORTED, event.result[:4] + bytes([GoalStatus.ABORTED]) + event.result[5:]
    return event.status, event.result


def _of_earlier_stay(work: Work, attempt: Attempt, event: Ended) -> bool:
    """Return whether a success of the previous holder counts: reached on its side and under its lease (rule 6)."""
    held = attempt.site is not work.holding.site and attempt.token.epoch < work.holding.token.epoch
    same_control = attempt.token.robot == work.holding.token.robot
    return attempt.site is Site.CLOUD and held and same_control and event.under_lease


def _early(work: Work, goal: Goal) -> bool:
    """Return whether an unrequested end is an effect of the change: within `timeout` after it (rule 3)."""
    spec = work.spec(goal)
    return goal.moved and spec.on_switch.resends and work.now_s < work.offers_until_s(goal)


def _gone(work: Work, event: Gone) -> None:
    goal, attempt = work.find(event.attempt)
    if goal is None or attempt is None or not attempt.phase.live:
        return
    counts = _counts(work, goal, attempt)
    goal = work.attempt(goal, replace(attempt, phase=AttemptPhase.GONE, ended_s=work.now_s))
    if goal.ended_s is not None:
        return
    if counts:
        _need_another(work, goal, Why.FORGOTTEN)


def _need_another(work: Work, goal: Goal, why: Why) -> None:
    """Offer another copy, or end the goal: the holder's copy was lost through no fault of the goal (rule 10)."""
    if goal.cancel:
        work.end(goal, GoalStatus.CANCELED, why=Why.CANCELED)
    elif work.spec(goal).on_switch.resends:
        work.put(replace(goal, need_s=work.now_s, able_s=None, moved=True, retry_s=0.0))
    else:
        work.end(goal, GoalStatus.ABORTED, why=why)
