"""Questions about a ledger and the view of a moment; nothing here changes anything."""

from __future__ import annotations

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.state import Attempt, AttemptPhase, CancelRequested, Goal, Ledger, View
from robot_offload_core.relay.goals.wire_ids import NO_GOAL
from robot_offload_core.words.declared import ActionSpec


def meant(asked: CancelRequested, goal_id: bytes, stamp_ns: int) -> bool:
    """Return whether a cancel means the goal with this id, accepted at `stamp_ns`."""
    if asked.goal_id == NO_GOAL and asked.stamp_ns == 0:
        return True
    return goal_id == asked.goal_id or (asked.stamp_ns > 0 and stamp_ns <= asked.stamp_ns)


def able(view: View, site: Site, action: str) -> bool:
    """Return whether a side's server can take a goal: CORE nodes Active, its own node Active, its server seen."""
    reachable = site is Site.ROBOT or view.heard
    return reachable and site in view.able and (site, action) in view.up


def there(view: View, name: str) -> bool:
    """Return whether a server with placement Cloud can be asked: its cloud is served and heard, the server is seen."""
    return view.present is not None and view.heard and (Site.CLOUD, name) in view.up


def acts(view: View, spec: ActionSpec) -> tuple[Site, Token | None]:
    """Return the side that executes goals of an action, and its token: the holder, or always the cloud by presence."""
    return (Site.CLOUD, view.present) if spec.of_cloud else (view.holding.site, view.holding.token)


def mirrored(view: View, spec: ActionSpec) -> tuple[Site, Token] | None:
    """Return the Hot standby that gets goals of an action too (`mirror`), and its token; None without one."""
    site = view.holding.site.other
    token = view.standby if site is Site.CLOUD else view.holding.token
    return (site, token) if spec.mirror and site in spec.hot and token is not None else None


def copy_of(goal: Goal, site: Site, token: Token | None) -> Attempt | None:
    """Return the attempt that counts on a side: the newest live one that is not to be cancelled.

    In the cloud it must carry this token. On the robot any token counts: nothing lies between its relay and its server.
    """
    for attempt in reversed(goal.attempts):
        if attempt.site is site and attempt.phase.live and not attempt.cancel:
            return attempt if site is Site.ROBOT or attempt.token == token else None
    return None


def is_resent(ledger: Ledger, attempt: bytes) -> bool:
    """Return whether the goal of an attempt was offered before, so that its execution begins anew."""
    return any(len(g.attempts) > 1 and any(a.id == attempt for a in g.attempts) for g in ledger.goals.values())


def overtaken(ledger: Ledger, goal: Goal, attempt: Attempt) -> bool:
    """Return whether the attempt was preempted: the same server accepted a later goal of the action after it."""
    return any(
        other.action == goal.action and other.order > goal.order and a.site is attempt.site and a.rank > attempt.rank
        for other in ledger.goals.values()
        for a in other.attempts
    )


def executing(ledger: Ledger, site: Site) -> tuple[str, ...]:
    """Return the actions of which a side executes an accepted attempt."""
    found = {
        goal.action
        for goal in ledger.goals.values()
        for a in goal.attempts
        if a.site is site and a.phase is AttemptPhase.ACCEPTED
    }
    return tuple(sorted(found))


def open_goals(ledger: Ledger, view: View) -> dict[str, tuple[int, int]]:
    """Return for each action how many goals the active side executes, and how many wait for it to accept them."""
    found = dict.fromkeys(ledger.actions, (0, 0))
    for goal in ledger.goals.values():
        if goal.ended_s is None:
            copy = copy_of(goal, *acts(view, ledger.actions[goal.action]))
            runs = copy is not None and copy.phase is AttemptPhase.ACCEPTED
            running, waiting = found[goal.action]
            found[goal.action] = (running + runs, waiting + (not runs))
    return found


def passes_feedback(ledger: Ledger, attempt: bytes, view: View) -> Goal | None:
    """Return the goal whose client gets the attempt's feedback; None unless it is the holder's copy."""
    goal = ledger.goals.get(ledger.index.get(attempt, b""))
    if goal is None or goal.ended_s is not None:
        return None
    copy = copy_of(goal, *acts(view, ledger.actions[goal.action]))
    return goal if copy is not None and copy.id == attempt else None


def busy(ledger: Ledger, site: Site, now_s: float) -> bool:
    """Return whether a side that no longer holds has attempts to end, within `cancel_deadline_s` of the change."""
    if ledger.holding.site is site or now_s >= ledger.changed_s + ledger.cancel_deadline_s:
        return False
    return any(a.site is site and a.phase.live and a.cancel for g in ledger.goals.values() for a in g.attempts)
