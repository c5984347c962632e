"""The levels that the robot's control keeps up in other processes: permission, gate and acting."""

from __future__ import annotations

from collections.abc import Iterator

from robot_offload_core.control.robot import fast_takeover, requests
from robot_offload_core.control.robot.placement import IN_CHARGE, Command, Permit, Robot
from robot_offload_core.control.robot.stalls import starved
from robot_offload_core.fence import grant
from robot_offload_core.fence.token import Site, presence
from robot_offload_core.words.beats import Permission
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import Acting
from robot_offload_core.words.gates import Gate, GateReport
from robot_offload_core.words.messages import SetGate
from robot_offload_core.words.replace import replace
from robot_offload_core.words.slow_outputs import SlowOutput


def outputs_flow_now(robot: Robot, now_s: float) -> bool:
    """Return whether no rated output of the robot is silent at the collector (known only while the robot acts).

    Without a collector nothing reaches the consumers.
    """
    if IN_CHARGE[robot.phase] is Site.CLOUD:
        return True
    started_s = robot.started_us / 1e6
    gate, reported_s = robot.situation.gate, robot.situation.gate_s
    if now_s - (started_s if reported_s is None else reported_s) > robot.settings.lease_s:
        return now_s < robot.stalls.until_s and not starved(robot, now_s)  # its reports may still be unread
    if now_s - max(robot.charged_s, started_s) < robot.settings.activation_deadline_s:
        return True
    return gate is not None and (gate.robot_flows or (bool(gate.robot_silent) and not _silent(robot, gate, now_s)))


def _silent(robot: Robot, gate: GateReport, now_s: float) -> tuple[int, ...]:
    """Return the outputs, by index, whose silence on the robot is a fault now."""
    excused = {one.index for one in _slow(robot) if one.excused(now_s)}
    return tuple(index for index in gate.robot_silent if index not in excused)


def _slow(robot: Robot) -> Iterator[SlowOutput]:
    bound_s = robot.settings.activation_deadline_s
    return (one for one in robot.slow if one.deadline_s > bound_s)


def outputs_heard_now(robot: Robot, now_s: float) -> bool:
    """Return whether the collector passes the robot and has seen a message of each rated output in time.

    A pause of any process or a new charge gives no grace. Only outputs that are slower than nodes activate get one: no
    message of theirs is needed until they have been silent for longer than their deadline.
    """
    if IN_CHARGE[robot.phase] is Site.CLOUD:
        return True
    gate, settings = robot.situation.gate, robot.settings
    reported_s = robot.situation.gate_s
    since_s = max(robot.charged_s, robot.started_us / 1e6)
    due = {i for i, o in enumerate(robot.outputs) if o.rated}
    due -= {one.index for one in _slow(robot) if not one.unseen(since_s, now_s)}
    if gate is not None:
        due -= set(gate.idle)
    if not due:
        return True
    if gate is None or reported_s is None or now_s - reported_s > settings.lease_s:
        return False
    passes = gate.charge is None or gate.charge.site is Site.ROBOT or gate.fell_back
    return passes and due <= set(gate.robot_flowing)


def give_out(robot: Robot, now_s: float, commands: list[Command]) -> Robot:
    """Send the three levels if they changed or a beat period has passed."""
    settings = robot.settings
    allowed = grant.permission(robot.grant, robot.link.peer)
    token = allowed.token
    armed = robot.preparation is not None and robot.preparation.armed
    gate_told = robot.situation.gate
    outputs_flow, outputs_heard = outputs_flow_now(robot, now_s), outputs_heard_now(robot, now_s)
    stop = requests.stop(robot) if robot.vetoes else ""
    silent = () if gate_told is None else gate_told.names(_silent(robot, gate_told, now_s), robot.outputs)
    cloud_while = _cloud_while(robot)
    prompt = robot.preparation is not None and robot.preparation.prompt
    floors = fast_takeover.floors(robot, now_s) if robot.early.floors else ()
    # All that the three levels are made of; they are built only when they are sent.
    levels = (
        token, allowed.granted, settings.lease_s, allowed.in_charge, robot.epoch, robot.candidate if armed else 0,
        robot.phase is Phase.CLOUD, outputs_flow, outputs_heard, stop, silent,
        robot.robot_while, cloud_while, prompt, floors,
    )  # fmt: skip
    if levels == robot.levels and now_s - robot.levels_s < settings.beat_period_s - 1e-6:
        return robot
    lease_us = round(settings.lease_s * 1e6)
    permission = Permission(
        token.epoch, allowed.granted, token.cloud, lease_us, allowed.in_charge, presence=bool(token.cloud)
    )
    following = grant.following(robot.grant) if armed else None
    present = presence(robot.incarnation, token.cloud) if token.cloud else None
    gate = Gate(
        robot.started_us, grant.current(robot.grant), following, said_s=now_s, presence=present, prompt=prompt,
        robot_while=robot.robot_while, cloud_while=cloud_while, floors=floors,
    )  # fmt: skip
    acting = Acting(
        acting=robot.phase is not Phase.CLOUD,
        outputs_flow=outputs_flow,
        in_charge=IN_CHARGE[robot.phase] is Site.ROBOT,
        stop=stop,
        outputs_heard=outputs_heard,
        silent=silent,
    )
    commands += [Permit(permission), SetGate(gate), acting]
    return replace(robot, levels=levels, levels_s=now_s)


def _cloud_while(robot: Robot) -> tuple[int, ...]:
    """Return the outputs, by index, whose `while` is true in the cloud's newest report."""
    report = robot.situation.report
    rated = 0 if report is None or report.serves != robot.incarnation else report.rated
    return tuple(i for i, o in enumerate(robot.outputs) if o.while_ is not None and rated >> i & 1)
