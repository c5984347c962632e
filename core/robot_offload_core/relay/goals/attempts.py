"""Compute which attempts there must be; offer, resume or cancel the difference.

Every goal has one copy at the holder; one at the candidate if it may be executed twice; none anywhere else.
"""

from __future__ import annotations

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.goals.questions import able, acts, copy_of, mirrored, overtaken, there
from robot_offload_core.relay.goals.state import (
    MIRROR_S,
    RETRY_S,
    Attempt,
    AttemptPhase,
    Cancel,
    Goal,
    Ledger,
    Offer,
    Resume,
    View,
    Why,
)
from robot_offload_core.relay.goals.work import Work
from robot_offload_core.words.declared import WITHOUT_LIMIT_S, ActionSpec, OnSwitch
from robot_offload_core.words.replace import replace

MOST_MOVES = 2
"""After this many changes of the side that made a `Resend` goal begin anew, a planned switch waits for its end."""


def settle(work: Work) -> None:
    """Bring the attempts to what they must be, goal by goal in the client's order."""
    for goal in work.live():
        if goal.cancel:
            _settle_cancelled(work, goal)
        else:
            _settle_holder(work, goal)
    for goal in work.live():
        mirror = _mirror_at(work, goal)
        if _is_copied(work, goal):
            _settle_candidate(work, goal)
        elif mirror is not None:
            _settle_mirror(work, goal, *mirror)
    for goal in work.all():
        if not goal.at_rest:
            _resume(work, goal)
    for goal in work.all():
        if not goal.at_rest:
            _end_unwanted(work, goal)


# -- the holder's copy ------------------------------------------------------------------------------------------------


def _settle_cancelled(work: Work, goal: Goal) -> None:
    """Make no further offer; end the goal if the holder has no copy that could still end by itself (rule 7)."""
    site, _ = work.acts(goal)
    on_holder = [a for a in goal.attempts if a.site is site and a.phase.live]
    late = work.now_s >= work.offers_until_s(goal) and all(a.phase is AttemptPhase.OFFERED for a in on_holder)
    if not on_holder or late or _away(work, goal):
        work.end(goal, GoalStatus.CANCELED, why=Why.CANCELED)


def _settle_holder(work: Work, goal: Goal) -> None:
    """Ensure that the holder has a copy or gets one, and end the goal when that takes too long (rules 1, 3, 12)."""
    site, token = work.acts(goal)
    if token is None or _away(work, goal):
        work.end(goal, GoalStatus.ABORTED, why=Why.CLOUD_AWAY)
        return
    is_able = work.spec(goal).of_cloud or able(work.view, site, goal.action)
    if goal.able_s is None and is_able:
        goal = replace(goal, able_s=work.now_s)
        work.put(goal)
    copy = copy_of(goal, site, token)
    if copy is not None and copy.phase is AttemptPhase.ACCEPTED:
        _show_executing(work, goal)
        return
    if work.now_s >= work.offers_until_s(goal):
        work.end(goal, GoalStatus.ABORTED, why=Why.NOT_ABLE if goal.able_s is None else Why.NO_ANSWER)
        return
    if copy is not None or _renew(work, goal):
        return
    if is_able and work.now_s >= goal.retry_s and _slot_free(work, goal, site):
        _offer(work, goal, site, token)


def _away(work: Work, goal: Goal) -> bool:
    """Return whether a goal of a node with placement Cloud has lost its cloud, or has another cloud now."""
    if not work.spec(goal).of_cloud:
        return False
    return not there(work.view, goal.action) or any(a.token != work.view.present for a in goal.attempts)


def _show_executing(work: Work, goal: Goal) -> None:
    """Show the client a copy that was accepted while its side prepared and is now the holder's."""
    if goal.status is GoalStatus.ACCEPTED:
        work.put(replace(goal, status=GoalStatus.EXECUTING))
        work.shown.add(goal.action)


def _renew(work: Work, goal: Goal) -> bool:
    """Move an attempt of the cloud to a newer epoch of the same side; return whether there was one."""
    return not work.spec(goal).of_cloud and _adopt(work, goal, work.holding.site, work.holding.token)


def _adopt(work: Work, goal: Goal, site: Site, token: Token) -> bool:
    """Put a side's live attempt, if there is one, under another token; return whether there was one."""
    attempt = _live_at(goal, site)
    if attempt is None:
        return False
    if attempt.token != token:
        work.attempt(goal, replace(attempt, token=token, resume=True))
    return True


def _live_at(goal: Goal, site: Site) -> Attempt | None:
    found = (a for a in reversed(goal.attempts) if a.site is site and a.phase.live and not a.cancel)
    return next(found, None)


def _slot_free(work: Work, goal: Goal, site: Site) -> bool:
    """Return whether no other offer of the action waits for its answer there: offers arrive in the client's order."""
    return not any(
        other.action == goal.action and a.site is site and a.phase is AttemptPhase.OFFERED and not a.cancel
        for other in work.goals.values()
        for a in other.attempts
    )


def _offer(work: Work, goal: Goal, site: Site, token: Token, *, mirror: bool = False) -> None:
    attempt = work.new_attempt(goal, site, token)
    work.commands.append(Offer(site, goal.action, attempt.id, goal.payload, token, mirror))


# -- the candidate's copy ---------------------------------------------------------------------------------------------


def _is_copied(work: Work, goal: Goal) -> bool:
    """Return whether the side that gets ready gets the goal too: `Resend` goals of CORE nodes (rule 2)."""
    spec, candidate = work.spec(goal), work.view.candidate
    return (
        candidate is not None
        and candidate[0] is not work.holding.site
        and spec.on_switch.resends
        and spec.core
        and not goal.cancel
    )


def _mirror_at(work: Work, goal: Goal) -> tuple[Site, Token] | None:
    """Return the Hot standby that executes the goal too (rule 9); None without one, or while that side prepares."""
    found = None if goal.cancel else mirrored(work.view, work.spec(goal))
    return None if found is None or _is_copied(work, goal) else found


def _settle_mirror(work: Work, goal: Goal, site: Site, token: Token) -> None:
    """Keep a copy at the Hot standby. A copy that has ended is not begun again while the goal runs at the holder."""
    if _adopt(work, goal, site, token) or any(_ended_itself(a, site) for a in goal.attempts):
        return
    if work.now_s >= goal.copy_retry_s and able(work.view, site, goal.action) and _slot_free(work, goal, site):
        _offer(work, goal, site, token, mirror=True)


def _ended_itself(attempt: Attempt, site: Site) -> bool:
    return attempt.site is site and attempt.phase is AttemptPhase.ENDED and not attempt.cancel


def unfit(ledger: Ledger, view: View, now_s: float) -> bool:
    """Return whether a mirror ended although its goal ran on at the holder for another second (rule 9)."""
    live = (goal for goal in ledger.goals.values() if goal.ended_s is None)
    found = ((goal, mirrored(view, ledger.actions[goal.action])) for goal in live)
    return any(
        at is not None and _ended_itself(a, at[0]) and now_s >= a.ended_s + MIRROR_S
        for goal, at in found
        for a in goal.attempts
    )


def _copy_at(goal: Goal, site: Site, token: Token) -> Attempt | None:
    """Return the live copy made for this very preparation."""
    found = (
        a for a in reversed(goal.attempts) if a.site is site and a.token == token and a.phase.live and not a.cancel
    )
    return next(found, None)


def preempted(ledger: Ledger, goal: Goal, site: Site, token: Token) -> bool:
    """Return whether the goal's copy there ended because a later goal was accepted; it is then never offered again."""
    return any(
        a.site is site
        and a.token == token
        and a.phase is AttemptPhase.ENDED
        and not a.cancel
        and overtaken(ledger, goal, a)
        for a in goal.attempts
    )


def _settle_candidate(work: Work, goal: Goal) -> None:
    assert work.view.candidate is not None
    site, token = work.view.candidate
    if work.spec(goal).mirror:
        _adopt(work, goal, site, token)
        goal = work.goals[goal.id]
    copy = _copy_at(goal, site, token)
    if copy is not None:
        late_s = copy.offered_s + work.spec(goal).timeout_s
        if copy.phase is AttemptPhase.OFFERED and work.now_s >= late_s:
            goal = _end_attempt(work, goal, copy)
            work.put(replace(goal, copy_retry_s=work.now_s + RETRY_S))
        return
    if work.now_s < goal.copy_retry_s or not able(work.view, site, goal.action) or not _slot_free(work, goal, site):
        return
    if not preempted(work.seen(), goal, site, token):
        _offer(work, goal, site, token)


def pending(ledger: Ledger, view: View) -> tuple[str, ...]:
    """Return the actions of which the candidate lacks an accepted copy of a goal; none without a candidate."""
    if view.candidate is None or view.candidate[0] is view.holding.site:
        return ()
    site, token = view.candidate
    lacking = []
    for goal in ledger.goals.values():
        spec = ledger.actions[goal.action]
        copied = goal.ended_s is None and not goal.cancel and spec.core and spec.on_switch.resends
        if not copied:
            continue
        copy = _copy_at(goal, site, token)
        if (copy is None or copy.phase is not AttemptPhase.ACCEPTED) and not preempted(ledger, goal, site, token):
            lacking.append(goal.action)
    return tuple(sorted(set(lacking)))


def waiting(ledger: Ledger, view: View, now_s: float) -> tuple[str, ...]:
    """Return the actions with a goal that the active side has not accepted for a while."""
    lacking = set()
    for goal in ledger.goals.values():
        if goal.ended_s is not None or goal.cancel or now_s < goal.need_s + RETRY_S:
            continue
        copy = copy_of(goal, *acts(view, ledger.actions[goal.action]))
        if copy is None or copy.phase is not AttemptPhase.ACCEPTED:
            lacking.add(goal.action)
    return tuple(sorted(lacking))


def held(ledger: Ledger) -> tuple[str, float]:
    """Return an action with a goal that a planned switch waits for, and the longest wait in seconds; ("", 0): none."""
    found = [(_held_for_s(goal, ledger.actions[goal.action]), goal.action) for goal in ledger.goals.values()]
    longest_s, action = max(found, default=(0.0, ""))
    return (action, longest_s) if longest_s > 0 else ("", 0.0)


def _held_for_s(goal: Goal, spec: ActionSpec) -> float:
    """Return how long a planned switch waits for a goal.

    A `Resend` goal that began anew MOST_MOVES times keeps its side: changes more frequent than the goal is long would
    starve it. A mirror is already in the middle of its goal, and a `Continue` goal loses nothing: neither starves.
    """
    if goal.ended_s is not None or spec.of_cloud:
        return 0.0
    if spec.on_switch is OnSwitch.HOLD:
        return spec.hold_for_s
    starves = spec.on_switch is OnSwitch.RESEND and not spec.mirror and goal.moves >= MOST_MOVES
    return WITHOUT_LIMIT_S if starves or spec.on_switch is OnSwitch.RESEND_ON_LOSS else 0.0


# -- the others -------------------------------------------------------------------------------------------------------


def _resume(work: Work, goal: Goal) -> None:
    """Ask the relay or server that knows an attempt for its state, as soon as it can be asked."""
    for attempt in goal.attempts:
        if not attempt.resume or (attempt.site is Site.CLOUD and not work.view.heard):
            continue
        phase, rank = attempt.phase, attempt.rank
        if phase.live:
            mirror = _mirror_at(work, goal) == (attempt.site, attempt.token)
            work.commands.append(Resume(attempt.site, goal.action, attempt.id, attempt.token, mirror))
            rank = rank or work.count()
            phase = AttemptPhase.ACCEPTED
            if attempt.cancel:
                work.commands.append(Cancel(attempt.site, goal.action, attempt.id))
        goal = work.attempt(goal, replace(attempt, resume=False, phase=phase, rank=rank))


def _end_unwanted(work: Work, goal: Goal) -> None:
    """Cancel every attempt that is not to run, and forget those that ended long ago."""
    wanted = _wanted(work, goal)
    for attempt in goal.attempts:
        if attempt.phase.live and not attempt.cancel and attempt.id not in wanted:
            goal = _end_attempt(work, goal, attempt)
    newest: dict[Site, bytes] = {a.site: a.id for a in goal.attempts if not a.phase.live}
    kept = tuple(a for a in goal.attempts if a.phase.live or newest[a.site] == a.id)
    if len(kept) < len(goal.attempts):
        work.put(replace(goal, attempts=kept))


def _wanted(work: Work, goal: Goal) -> set[bytes]:
    if goal.ended_s is not None or goal.cancel:
        return set()
    found = [copy_of(goal, *work.acts(goal))]
    if _is_copied(work, goal):
        assert work.view.candidate is not None
        found.append(_copy_at(goal, *work.view.candidate))
    elif (mirror := _mirror_at(work, goal)) is not None:
        found.append(_live_at(goal, mirror[0]))
    return {attempt.id for attempt in found if attempt is not None}


def _end_attempt(work: Work, goal: Goal, attempt: Attempt) -> Goal:
    work.commands.append(Cancel(attempt.site, goal.action, attempt.id))
    return work.attempt(goal, replace(attempt, cancel=True))
