"""Takeover by silence: a robot whose replicas are Hot goes on at once when a message of the cloud is missing.

What it rests on is weaker than a broken limit (the collector says that one message is late, lateness.py), so it is
judged afterwards. When a hard limit of the cloud breaks within two loss timeouts it was a loss like every other: the
sessions are reopened, a wish by hand for the cloud ends, the policy learns. Else it may have been a mistake, which
costs two changes of side and nothing more; the third within ten minutes starts the hold-down, and no message is taken
for lost any more until a stay in the cloud has lasted a minute.

A mistake also teaches: for an hour its outputs are waited for a period longer than they were. The collector learns the
same from messages that come late, but a message that was lost never comes, and a cloud that has just been left sends
nothing more that could show how long its silence would have been.
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
"""Loss timeouts after which a takeover that no limit confirmed is taken for a mistake."""
ROW_S = 600.0
"""Mistakes further apart than this are not counted as a row."""
MOST = 3
FLOOR_S = 3600.0
"""How long a mistake keeps the margin of its outputs up."""
PROVEN_S = 60.0
"""A stay of this length in the cloud shows that its messages come in time again."""


def missed(robot: Robot) -> Verdict | None:
    """Return the loss that a missing message of the cloud means; None when there is none, or it proves nothing."""
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
    """Return the outputs whose next message of the cloud is missing, by index, and when each was due."""
    gate = robot.situation.gate
    missed_ = () if gate is None else gate.missed
    return tuple((index, due_s) for index, due_s in missed_ if _was_due(robot, index, due_s))


def _unfit(robot: Robot) -> bool:
    """Return whether the robot has given up a goal that the cloud still executes: it would begin that anew."""
    report = robot.handing.report
    return report is not None and report.unfit


def _was_due(robot: Robot, index: int, due_s: float) -> bool:
    """Return whether a message had to come: with `while`, if a later beat of the cloud still calls the output rated.

    The beat shows that by what it echoes: a beat of ours from after that time.
    """
    if robot.outputs[index].while_ is None:
        return True
    report, echo_s = robot.situation.report, robot.link.echo_sent_s
    return report is not None and bool(report.rated >> index & 1) and echo_s is not None and echo_s >= due_s


def taken(robot: Robot, now_s: float) -> Robot:
    """Note a takeover by silence. The cloud is not asked again before it was judged."""
    early = replace(robot.early, taken_s=now_s, missing=_missing(robot))
    return replace(robot, early=early, retry_s=now_s + JUDGED_TIMEOUTS * robot.settings.loss_timeout_s)


def judge(robot: Robot, fault: Verdict | None, now_s: float, commands: list[Command]) -> Robot:
    """Judge the last takeover by silence; `fault`: the limit that is broken since, None while all hold."""
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
    """Return the floors after a mistake: a period more than its outputs had been waited for when it was made."""
    missing = {index: taken_s - due_s + robot.outputs[index].period_s for index, due_s in robot.early.missing}
    others = (floor for floor in robot.early.floors if floor.index not in missing and taken_s < floor.until_s)
    return (*others, *(Floor(index, margin_s, taken_s + FLOOR_S) for index, margin_s in missing.items()))


def floors(robot: Robot, now_s: float) -> tuple[tuple[int, float], ...]:
    """Return the outputs, by index, that are waited for longer because of a mistake, and the least margins."""
    return tuple((floor.index, floor.margin_s) for floor in robot.early.floors if now_s < floor.until_s)


def prove(robot: Robot, now_s: float) -> Robot:
    """Wait for messages again once a stay in the cloud has lasted."""
    if robot.early.off and robot.phase is Phase.CLOUD and now_s - robot.charged_s > PROVEN_S:
        return replace(robot, early=Early(floors=robot.early.floors))
    return robot
