"""What a commanded change waits for besides nodes and outputs: goals, requests and state on the side that gets ready.

The robot's control judges it, only while a side gets ready. A takeover after a loss does not wait for any of it, nor
does a change from a robot that cannot act, and none of it ends a stay.
"""

from __future__ import annotations

from robot_offload_core.control.robot.placement import Handing, Preparation, RelayReported, Robot
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import StateReported
from robot_offload_core.words.reasons import Kind, Reason, Verdict
from robot_offload_core.words.replace import replace

REASONS = {reason.value: reason for reason in (Reason.GOALS_PENDING, Reason.DIVERGED, Reason.STATE_STALE)}


def lacking(robot: Robot) -> Verdict | None:
    """Return a finding of other processes that keeps the policy from the cloud, but not a person or a robot in need."""
    found = (veto for vetoed in robot.vetoes for veto in vetoed.vetoes if not veto.reason.forbids)
    return next((Verdict(Site.ROBOT, veto.reason, veto.message) for veto in found), None)


def pending(robot: Robot, preparation: Preparation, *, without_state: bool = False) -> Verdict | None:
    """Return what the side that gets ready lacks, as reported by the relay and the replicas; None if nothing."""
    candidate = Site.CLOUD if robot.phase is Phase.TO_CLOUD else Site.ROBOT
    lacks = lacking(robot) if candidate is Site.CLOUD else None
    lacks = lacks or (None if without_state else _stale(robot, preparation, candidate))
    if lacks is not None or not robot.handing.served:
        return lacks
    report, preparing = robot.handing.report, robot.epoch
    if report is None or report.candidate is None or report.candidate.epoch != robot.candidate:
        return Verdict(candidate.other, Reason.GOALS_PENDING, f"The relay does not know of the change from {preparing}")
    if not report.pending:
        return None
    reason, message = report.pending[0]
    return Verdict(candidate.other, REASONS.get(reason, Reason.GOALS_PENDING), message)


def _stale(robot: Robot, preparation: Preparation, candidate: Site) -> Verdict | None:
    """Return what the side that gets ready lacks of the active side's state; None if nothing."""
    if not robot.handing.kept:
        return None
    told = _said_of(robot.handing, candidate)
    if told is None or told.epoch != robot.candidate:
        message = f"The data process of the {candidate.value} does not know of the change"
        return Verdict(candidate.other, Reason.STATE_STALE, message)
    return Verdict(candidate.other, Reason.STATE_STALE, told.lacking[0]) if told.lacking else None


def _said_of(known: Handing, site: Site) -> StateReported | None:
    return next((reported for reported in known.states if reported.site is site), None)


def begins(robot: Robot, wish: Verdict, now_s: float) -> tuple[Robot, Verdict | None]:
    """Return why a change to the side of `wish` does not begin yet; None if it begins.

    A node takes its state when it becomes Active, so its side must not get ready before the state is there. Before a
    stay in the cloud the policy waits for that without limit. A person waits no longer than a preparation may take, and
    so does any change to the robot: the sooner its nodes are Active, the shorter a loss is. A veto does not wait.
    """
    lacks = _unknown(robot, wish.site)
    if lacks is None or wish.reason.kind is Kind.VETO:
        return _lacked(robot, None), None
    robot = _lacked(robot, now_s) if robot.handing.lacked_s is None else robot
    return robot, None if _waited_out(robot, wish, now_s) else lacks


def _unknown(robot: Robot, candidate: Site) -> Verdict | None:
    """Return what the nodes of a side would lack if they became Active now; None if nothing."""
    if not robot.handing.kept:
        return None
    told = _said_of(robot.handing, candidate)
    message = f"The data process of the {candidate.value} has not said yet which state it knows"
    if told is not None:
        message = told.before_active[0] if told.before_active else ""
    return Verdict(candidate.other, Reason.STATE_STALE, message) if message else None


def _waited_out(robot: Robot, wish: Verdict, now_s: float) -> bool:
    """Return whether a change has waited for state long enough and begins without it."""
    since_s = robot.handing.lacked_s
    bounded = wish.site is Site.ROBOT or wish.reason.urgent
    return bounded and since_s is not None and now_s - since_s >= robot.settings.preparing_s


def content(robot: Robot) -> Robot:
    """Return the robot without a change that waits for state, as no change is wanted."""
    return _lacked(robot, None)


def _lacked(robot: Robot, lacked_s: float | None) -> Robot:
    if robot.handing.lacked_s == lacked_s:
        return robot
    return replace(robot, handing=replace(robot.handing, lacked_s=lacked_s))


def told(known: Handing, report: RelayReported | StateReported) -> Handing:
    """Return what is handed over, with the newest report of the relay or of a data process."""
    if isinstance(report, RelayReported):
        return replace(known, report=report)
    return replace(known, states=(*(s for s in known.states if s.site is not report.site), report))


def may_arm(robot: Robot, preparation: Preparation, wish: Verdict, now_s: float) -> bool:
    """Return whether the collector may change over as far as goals, requests and state go.

    A pin, a switch by hand or a veto waits until the deadline, then changes over without them. It waits for state only
    once, before or during the preparation. A veto that hardens does not wait for any of them.
    """
    impatient = wish.reason.hardens or (wish.reason.urgent and now_s >= preparation.patient_until_s)
    without_state = wish.reason.urgent and _waited_out(robot, wish, now_s)
    return preparation.need or impatient or pending(robot, preparation, without_state=without_state) is None


def hold(robot: Robot, wish: Verdict, now_s: float) -> tuple[Robot, bool]:
    """Return whether a planned switch waits for a goal that must not be interrupted.

    It waits at most as long as the relay states. Pins, vetoes, switches by hand and a side that cannot act do not wait.
    """
    report, held_s = robot.handing.report, robot.handing.held_s
    goal = report is not None and report.hold != ""
    if not goal or wish.reason.urgent or wish.reason.kind is Kind.NEED:
        return (robot if held_s is None else _held(robot, None)), False
    if held_s is None:
        return _held(robot, now_s), True
    return robot, report is not None and now_s - held_s < report.hold_for_s


def _held(robot: Robot, held_s: float | None) -> Robot:
    return replace(robot, handing=replace(robot.handing, held_s=held_s))


def interrupts(robot: Robot, wish: Verdict, now_s: float) -> tuple[Robot, Verdict | None]:
    """Return why a preparation is called off, because a goal began that must not be interrupted; None for no reason.

    Once the gate is armed, the collector may have changed over already: calling off would be a change back.
    """
    preparation = robot.preparation
    if preparation is None or preparation.need or preparation.armed:
        return robot, None
    robot, waits = hold(robot, wish, now_s)
    report = robot.handing.report
    if not waits or report is None:
        return robot, None
    site = Site.ROBOT if robot.phase is Phase.TO_CLOUD else Site.CLOUD
    return robot, Verdict(site, Reason.GOALS_PENDING, f"A goal of {report.hold} runs that must not be interrupted")
