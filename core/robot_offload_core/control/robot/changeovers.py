"""How a changeover begins, succeeds, is called off or comes at once; each has its own epoch and is announced."""

from __future__ import annotations

from robot_offload_core.control.robot.placement import IN_CHARGE, Command, Preparation, Robot
from robot_offload_core.fence import grant
from robot_offload_core.fence.grant import Grant
from robot_offload_core.fence.token import Site
from robot_offload_core.link import policies
from robot_offload_core.words.beats import PERMISSION_BEATS
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.messages import Reopen
from robot_offload_core.words.reasons import Kind, Verdict
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Settings

PREPARE_EXTRA_S = 0.5
"""Added to the deadline of a commanded switch, as outputs must flow; slow ones get their own deadline instead."""
REPORT_BEATS = 2
"""Beats added to that, for the grant to arrive and the report to come back."""
RETRY_FIRST_S = 1.0
"""Wait after the first preparation that was called off; doubled by each further one."""
RETRY_MAX_S = 30.0
"""Longest such wait."""
DECIDED_PERIOD_S = 0.5
"""Least time between two announcements that differ only in their reason."""


def stopped_s(settings: Settings) -> float:
    """Return after how long the cloud has stopped for sure when nothing permits it to act any more, seconds.

    The pulse process may use the last permission for two more beats; the lease granted then begins at that time.
    """
    return PERMISSION_BEATS * settings.beat_period_s + settings.lease_s + settings.drift_s


def prepare(robot: Robot, phase: Phase, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    """Begin to get the other side ready, under a candidate epoch."""
    settings = robot.settings
    need = verdict.reason.kind is Kind.NEED
    prompt = need or verdict.reason.kind is Kind.VETO
    slowest_s = robot.slowest_output_s(prompt=prompt)
    flow_s = max(PREPARE_EXTRA_S, slowest_s) + REPORT_BEATS * settings.beat_period_s
    patient_until_s = now_s + settings.preparing_s
    deadline_s = patient_until_s + flow_s
    preparation = Preparation(deadline_s, need=need, prompt=prompt, patient_until_s=patient_until_s)
    granted = grant.prepare(robot.grant, robot.link.peer)
    robot = replace(robot, phase=phase, since_s=now_s, grant=granted, preparation=preparation)
    if phase is Phase.TO_CLOUD:
        robot = replace(robot, situation=replace(robot.situation, good_s=None))
    return decide(robot, verdict, now_s, commands, force=True)


def enter(robot: Robot, entered: Grant, now_s: float, commands: list[Command]) -> Robot:
    """Take that the collector has changed over to what was the candidate; `entered`: the grant since then."""
    phase = Phase.CLOUD if entered.site is Site.CLOUD else Phase.ROBOT
    good_s = robot.situation.good_s
    robot = replace(
        robot, phase=phase, since_s=now_s, charged_s=now_s, grant=entered, preparation=None,
        failures=0, retry_s=0.0, both_silent=False,
        situation=replace(robot.situation, good_s=now_s if good_s is None else good_s),
    )  # fmt: skip
    policy = robot.policy
    if phase is Phase.ROBOT and not robot.decided.reason.urgent:
        policy = policies.lost(policy, robot.settings, now_s)
    robot = replace(robot, policy=policies.entered(policy, entered.site, now_s))
    return decide(robot, robot.decided, now_s, commands, force=True, switched=True)


def call_off(robot: Robot, phase: Phase, why: Verdict, now_s: float, commands: list[Command]) -> Robot:
    """Give up a preparation: the old side goes on, and the next attempt waits unless the reason is urgent."""
    failed = not why.reason.urgent
    wait_s = min(RETRY_MAX_S, RETRY_FIRST_S * 2**robot.failures) if failed else 0.0
    robot = replace(
        robot, phase=phase, since_s=now_s, grant=grant.call_off(robot.grant, now_s, stopped_s(robot.settings)),
        preparation=None, failures=robot.failures + failed, retry_s=now_s + wait_s,
    )  # fmt: skip
    return decide(robot, why, now_s, commands, force=True)


def take_over(
    robot: Robot, fault: Verdict, now_s: float, commands: list[Command], *, by_silence: bool = False
) -> Robot:
    """Put the robot in charge at once after a sudden loss; consumers hear only the robot from now on.

    `by_silence`: only one message is missing and may still come, so sessions, wishes and the policy's state stay.
    """
    silent_s = None if robot.situation.good_s is None else now_s - robot.situation.good_s
    phase = Phase.ROBOT if robot.nodes_ready else Phase.TAKEOVER
    policy = robot.policy if by_silence else policies.lost(robot.policy, robot.settings, now_s)
    policy = policies.entered(policy, Site.ROBOT, now_s)
    # A loss ends the wish for the cloud, which would override the hold-down and flap with the link.
    keeps = by_silence or (robot.manual is not None and robot.manual.site is Site.ROBOT)
    manual = robot.manual if keeps else None
    robot = replace(
        robot, phase=phase, since_s=now_s, charged_s=now_s, preparation=None,
        grant=grant.take_over(robot.grant, now_s, stopped_s(robot.settings)),
        failures=0, both_silent=False, retry_s=0.0, manual=manual, policy=policy,
        situation=replace(robot.situation, good_s=None),
    )  # fmt: skip
    if not by_silence:
        commands.append(Reopen(fault.reason))
    return decide(robot, fault, now_s, commands, force=True, switched=True, silent_s=silent_s)


def decide(
    robot: Robot, verdict: Verdict, now_s: float, commands: list[Command], *,
    force: bool = False, switched: bool = False, silent_s: float | None = None,
) -> Robot:  # fmt: skip
    """Announce a decision if it changed, at most every DECIDED_PERIOD_S; with `force` at once."""
    changed = (verdict.site, verdict.reason) != (robot.decided.site, robot.decided.reason)
    if not force and not (changed and now_s - robot.decided_s >= DECIDED_PERIOD_S):
        return robot
    commands.append(Decided(IN_CHARGE[robot.phase], robot.epoch, robot.phase, verdict, switched, silent_s))
    return replace(robot, decided=verdict, decided_s=now_s)
