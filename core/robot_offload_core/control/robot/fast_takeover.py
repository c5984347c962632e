"""Takeover by silence: a robot whose replicas are Hot takes over at once if a message of the cloud is missing.

The evidence is weaker than a broken limit (the collector reports that one message is late, lateness.py), so the
takeover is judged afterwards. If a hard limit of the cloud breaks within two loss timeouts, it was a loss like any
other: the sessions are reopened, a wish by hand for the cloud ends, the policy learns. Otherwise it may have been a
mistake, which costs only two changes of side. The third mistake within ten minutes starts the hold-down, and no message
counts as lost until a stay in the cloud has lasted a minute.

A mistake also teaches: for an hour the margin of its outputs is a period longer than it was. The collector learns the
same from late messages, but a lost message never comes, and a cloud that was just left sends nothing that could show
how long its silence would have been.
"""

from __future__ import annotations

from robot_offload_core.control.robot.placement import Command, Early, Floor, Robot
from robot_offload_core.fence.token import Site
from robot_offload_core.link import policies
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.messages import Reopen
from robot_offload_core.words.reasons import Reason, Verdict
from robot_offload_core.words.replace import replace

JUDGED_TIMEOUTS = 2
"""Loss timeouts after which a takeover counts as a mistake, unless a broken limit has confirmed it."""
ROW_S = 600.0
"""Mistakes further apart than this are not counted as a row."""
MOST = 3
FLOOR_S = 3600.0
"""How long a mistake increases the margin of its outputs."""
PROVEN_S = 60.0
"""A stay in the cloud of this length shows that its messages come in time again."""


def missed(robot: Robot) -> Verdict | None:
    """Return the loss that a missing message of the cloud proves; None if none is missing, or if it proves nothing."""
    gate, early = robot.situation.gate, robot.early
    if gate is None or not gate.missed or early.off or not (robot.hot and robot.nodes_ready) or _unfit(robot):
        return None
    if gate.charge is None or gate.charge.token.epoch != robot.epoch or gate.charge.token.robot != robot.incarnation:
        return None
    lost = _missing(robot)
    if not lost:
        return None
    names = ", ".join(gate.names(tuple(index for index, _ in lost), robot.outputs))
    return Verdict(Site.ROBOT, Reason.OUTPUT_SILENT, f"The cloud's next message of {names} did not come in time")


def _missing(robot: Robot) -> tuple[tuple[int, float], ...]:
    """Return (index, due time) of the outputs whose next message of the cloud is missing."""
    gate = robot.situation.gate
    missed_ = () if gate is None else gate.missed
    return tuple((index, due_s) for index, due_s in missed_ if _was_due(robot, index, due_s))


def _unfit(robot: Robot) -> bool:
    """Return whether the robot has given up a goal that the cloud still executes, so that it would begin it anew."""
    report = robot.handing.report
    return report is not None and report.unfit


def _was_due(robot: Robot, index: int, due_s: float) -> bool:
    """Return whether a message had to come: with `while`, if a later beat of the cloud reports the output as rated.

    A beat is later if it echoes a beat that we sent after that time.
    """
    if robot.outputs[index].while_ is None:
        return True
    report, echo_s = robot.situation.report, robot.link.echo_sent_s
    return report is not None and bool(report.rated >> index & 1) and echo_s is not None and echo_s >= due_s


def taken(robot: Robot, now_s: float) -> Robot:
    """Record a takeover by silence. The cloud is not asked again before the takeover was judged."""
    early = replace(robot.early, taken_s=now_s, missing=_missing(robot))
    return replace(robot, early=early, retry_s=now_s + JUDGED_TIMEOUTS * robot.settings.loss_timeout_s)


def judge(robot: Robot, fault: Verdict | None, now_s: float, commands: list[Command]) -> Robot:
    """Judge the last takeover by silence; `fault`: a limit broken since then, None while all hold."""
    early, settings = robot.early, robot.settings
    if early.taken_s is None:
        return robot
    if fault is not None:
        commands.append(Reopen(fault.reason))
        manual = robot.manual if robot.manual is not None and robot.manual.site is Site.ROBOT else None
        policy = policies.lost(robot.policy, settings, now_s)
        confirmed = replace(early, taken_s=None, missing=())
        return replace(robot, early=confirmed, manual=manual, policy=policy, retry_s=0.0)
    if now_s - early.taken_s < JUDGED_TIMEOUTS * settings.loss_timeout_s:
        return robot
    mistakes = (*(s for s in early.mistakes_s if early.taken_s - s <= ROW_S), early.taken_s)
    learned = Early(mistakes_s=mistakes, floors=_learned(robot, early.taken_s))
    if len(mistakes) < MOST:
        return replace(robot, early=learned)
    off = replace(learned, mistakes_s=(), off=True)
    return replace(robot, early=off, policy=policies.flapped(robot.policy, settings, now_s))


def _learned(robot: Robot, taken_s: float) -> tuple[Floor, ...]:
    """Return the floors after a mistake: how long each message was overdue at the takeover, plus a period."""
    missing = {index: taken_s - due_s + robot.outputs[index].period_s for index, due_s in robot.early.missing}
    others = (floor for floor in robot.early.floors if floor.index not in missing and taken_s < floor.until_s)
    return (*others, *(Floor(index, margin_s, taken_s + FLOOR_S) for index, margin_s in missing.items()))


def floors(robot: Robot, now_s: float) -> tuple[tuple[int, float], ...]:
    """Return (index, least margin) of the outputs with a longer margin because of a mistake."""
    return tuple((floor.index, floor.margin_s) for floor in robot.early.floors if now_s < floor.until_s)


def prove(robot: Robot, now_s: float) -> Robot:
    """Allow takeovers by silence again once a stay in the cloud has lasted long enough."""
    if robot.early.off and robot.phase is Phase.CLOUD and now_s - robot.charged_s > PROVEN_S:
        return replace(robot, early=Early(floors=robot.early.floors))
    return robot
