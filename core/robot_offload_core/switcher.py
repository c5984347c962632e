"""The placement machine of the robot's side: the robot is the authority, the actuators are there.

Phases: ROBOT (the robot acts), TO_CLOUD (it acts while the cloud gets ready under a candidate epoch), CLOUD,
TO_ROBOT (the cloud acts while the robot's nodes wake), TAKEOVER (the robot is in charge after a sudden loss, its CORE
nodes are still waking). Every changeover, also one that is called off, uses a new epoch, so that the collector never
has to go back. What the shell keeps up (permission, gate, acting) is a level, told again with every beat period.
"""

from __future__ import annotations

from robot_offload_core import early, handing, links, policies, wishes
from robot_offload_core.beats import CloudReport, Permission
from robot_offload_core.change import replace
from robot_offload_core.checks import require
from robot_offload_core.collectors import Charge, Gate, GateReport
from robot_offload_core.events import Acting, Tick, assert_never
from robot_offload_core.health import Frame, is_good
from robot_offload_core.limits import cloud_fault
from robot_offload_core.placement import (
    IN_CHARGE,
    Answer,
    CloudBeat,
    CloudLeaving,
    Command,
    DataReported,
    Decided,
    Event,
    GateReported,
    NodesReported,
    Permit,
    Phase,
    Preparation,
    PulseSent,
    RelayReported,
    Reopen,
    Robot,
    SetGate,
    SetPin,
    SetSettings,
    StateReported,
    SwitchByHand,
    Vetoed,
    WhileReported,
    Wish,
)
from robot_offload_core.pulse import PERMISSION_BEATS
from robot_offload_core.reasons import Kind, Reason, Verdict
from robot_offload_core.settings import Mode, Settings
from robot_offload_core.settling import meanwhile
from robot_offload_core.token import Site, Token, presence

PREPARE_EXTRA_S = 0.5
"""Added to the activation deadline for a commanded switch: outputs must flow; slow ones get their deadline instead."""
REPORT_BEATS = 2
"""Beats added to that: the grant must go there, the report must come back."""
RETRY_FIRST_S = 1.0
RETRY_MAX_S = 30.0
HEALTHY_S = 0.5
"""Without a stall for so long our process is healthy: a later stall begins a new row (see Stalls)."""
DECIDED_PERIOD_S = 0.5
"""Changes of reason that change nothing else are given out at most this often."""


def step(robot: Robot, event: Event, now_s: float) -> tuple[Robot, list[Command]]:
    """Takes in one event, decides, and gives out the levels when they changed or a beat period has passed."""
    commands: list[Command] = []
    before = robot
    robot = _notice_stall(robot, now_s)
    robot = _take(robot, event, now_s, commands)
    if robot.asked is not None:
        robot = _settle(robot, robot.asked, now_s)
    robot = _move(robot, now_s, commands)
    robot = _tell(robot, now_s, commands)
    check(before, robot, event)
    return robot, commands


def check(before: Robot, after: Robot, event: Event) -> None:
    """Raises InvariantError when the step from `before` to `after` broke what every step must keep."""
    preparing = after.phase in (Phase.TO_CLOUD, Phase.TO_ROBOT)
    changed = site(after) is not site(before)
    require(
        "switcher",
        event,
        (after.epoch >= before.epoch, "the epoch fell"),
        (after.last_epoch >= max(before.last_epoch, after.epoch, after.candidate), "an epoch was used beyond the last"),
        (not changed or after.epoch > before.epoch, "the side in charge changed within one epoch"),
        ((after.preparation is not None) is preparing, "a preparation exactly while a side gets ready"),
        (not preparing or after.candidate > after.epoch, "the candidate is not newer than who is in charge"),
        (after.partner != "" or (site(after) is Site.ROBOT and not preparing), "the cloud is addressed by no name"),
        (after.incarnation == before.incarnation, "the incarnation changed"),
    )


def site(robot: Robot) -> Site:
    """The side in charge."""
    return IN_CHARGE[robot.phase]


def effects_site(robot: Robot, now_s: float) -> Site | None:
    """The side whose effects that are not collected are admitted now; None while the other might still act."""
    if site(robot) is Site.CLOUD:
        return Site.CLOUD
    if robot.preparation is not None and robot.preparation.offered:
        return None  # the collector may change over at any moment, and we hear of it later
    clear_s = _clear_s(robot, robot.started_us / 1e6) if robot.clear_s is None else robot.clear_s
    return Site.ROBOT if now_s >= clear_s else None


def _clear_s(robot: Robot, revoked_s: float) -> float:
    """When the cloud has stopped for sure, if nothing permits it to act after `revoked_s`.

    The pulse process may use the last permission for two more beats, and the lease that it grants then lasts from
    there.
    """
    settings = robot.settings
    return revoked_s + PERMISSION_BEATS * settings.beat_period_s + settings.lease_s + settings.drift_s


def _notice_stall(robot: Robot, now_s: float) -> Robot:
    """Notices that our own steps came late.

    The queues between our processes hold only so much: what came last during a stall may be lost. Therefore silence
    counts from the end of the stall (for no longer than a lease, see limits.cloud_fault).
    """
    stalls, settings = robot.stalls, robot.settings
    if stalls.stepped_s is not None and now_s - stalls.stepped_s > settings.stall_s:
        in_a_row = stalls.last_s is not None and now_s - stalls.last_s < HEALTHY_S
        first_s = stalls.first_s if in_a_row else now_s
        stalls = replace(stalls, until_s=now_s + settings.loss_timeout_s, last_s=now_s, first_s=first_s)
    return replace(robot, stalls=replace(stalls, stepped_s=now_s))


def _starved(robot: Robot, now_s: float) -> bool:
    """Stalls have followed each other for longer than a lease: to wait for the end of the last one is no answer."""
    stalls = robot.stalls
    return now_s < stalls.until_s and now_s - stalls.first_s > robot.settings.lease_s


def _settle(robot: Robot, asked: Settings, now_s: float) -> Robot:
    """Takes over changed settings, all of them once the cloud has stopped for sure."""
    if robot.phase is Phase.ROBOT and effects_site(robot, now_s) is Site.ROBOT:
        return replace(robot, settings=asked, asked=None)
    return replace(robot, settings=meanwhile(robot.settings, asked))


# -- taking events in -------------------------------------------------------------------------------------------------


def _take(robot: Robot, event: Event, now_s: float, commands: list[Command]) -> Robot:  # noqa: C901 - a flat table
    match event:
        case CloudBeat():
            robot = _hear(robot, event, now_s)
        case PulseSent():
            robot = _note_sent(robot, event)
        case GateReported():
            robot = _gate_reported(robot, event.report, now_s, commands)
        case DataReported():
            heard_s = None if event.age_s is None else now_s - event.age_s
            data = replace(robot.situation, data_connected=event.connected, data_heard_s=heard_s)
            robot = replace(robot, situation=replace(data, data_cloud=event.cloud, data_s=now_s))
        case NodesReported():
            robot = replace(robot, nodes_ready=event.ready, duplicated=event.duplicated, hot=event.hot)
        case WhileReported():
            robot = replace(robot, robot_while=event.outputs)
        case Vetoed():
            others = tuple(v for v in robot.vetoes if v.source != event.source)
            robot = replace(robot, vetoes=(*others, event) if event.vetoes else others)
        case SetPin():
            robot = replace(robot, pin=event.pin)
        case CloudLeaving():
            robot = replace(robot, leaving=event)
        case SetSettings():
            robot = replace(robot, asked=event.settings, inputs=event.inputs)
        case RelayReported() | StateReported():
            robot = replace(robot, handing=handing.told(robot.handing, event))
        case SwitchByHand():
            robot, accepted, message = _by_hand(robot, event.site, now_s)
            commands.append(Answer(event.key, accepted, message))
        case Tick():
            robot = replace(robot, stalls=replace(robot.stalls, read_s=now_s))
        case _:
            assert_never(event)
    return robot


def _note_sent(robot: Robot, sent: PulseSent) -> Robot:
    return replace(robot, situation=replace(robot.situation, pulse_s=sent.sent_s))


def _hear(robot: Robot, event: CloudBeat, now_s: float) -> Robot:
    beat = event.beat
    if event.sent is not None:
        robot = _note_sent(robot, event.sent)
    link = robot.link
    stranger = link.peer and beat.incarnation != link.peer
    live = link.heard_s is not None and now_s - link.heard_s <= robot.settings.loss_timeout_s
    if stranger and live:
        return robot  # a second cloud agent, or late words of an old one: the one we hear goes on
    heard = links.hear(link, beat, robot.incarnation, event.arrived_s, event.wall_us)
    robot = replace(robot, link=heard, policy=policies.echoed(robot.policy, link, heard, robot.settings))
    if not isinstance(beat.body, CloudReport):
        return robot  # a bare beat feeds statistics only
    control_age_s = None if beat.control_age_us < 0 else beat.control_age_us / 1e6
    robot = replace(robot, situation=replace(robot.situation, report=beat.body, control_age_s=control_age_s))
    epoch = robot.candidate if robot.phase is Phase.TO_CLOUD else robot.epoch
    if is_good(beat, event.arrived_s, robot.link, frame(robot, now_s)._replace(epoch=epoch)):
        robot = replace(robot, situation=replace(robot.situation, good_s=event.arrived_s))
    return robot


def _gate_reported(robot: Robot, report: GateReport, now_s: float, commands: list[Command]) -> Robot:
    robot = replace(robot, situation=replace(robot.situation, gate=report, gate_s=now_s))
    charge = report.charge
    # Also after a preparation was called off: the collector may have changed over just before it heard of that.
    if charge is not None and charge.token.robot == robot.incarnation and charge.token.epoch > robot.epoch:
        return _enter(robot, charge, now_s, commands)
    return robot


def _by_hand(robot: Robot, asked: Site, now_s: float) -> tuple[Robot, bool, str]:
    pin = wishes.pin(robot, now_s)
    if robot.settings.mode is Mode.OBSERVE:
        return robot, False, "Refused (Observe): this agent only observes; set mode to Auto"
    if pin is not None and pin is not asked:
        return robot, False, f"Refused (Pinned): placement is pinned to the {pin.value}; clear the pin first"
    if asked is Site.CLOUD and IN_CHARGE[robot.phase] is Site.ROBOT:
        fault = _fault(robot, now_s, acting=False)
        fault = fault or wishes.veto(robot, now_s)
        if fault is not None:
            return robot, False, f"Refused ({fault.reason}): {fault.message}"
    robot = replace(robot, manual=Wish(asked, now_s + robot.settings.manual_hold_s))
    if IN_CHARGE[robot.phase] is asked and robot.phase not in (Phase.TO_CLOUD, Phase.TO_ROBOT):
        return robot, True, f"The {asked.value} is in charge already"
    return robot, True, f"Switching to the {asked.value}"


# -- deciding ---------------------------------------------------------------------------------------------------------


def frame(robot: Robot, now_s: float) -> Frame:
    """Returns what the situation is judged against."""
    return Frame(
        robot.incarnation, robot.partner, robot.epoch, robot.settings, robot.inputs, robot.stalls.until_s,
        _starved(robot, now_s), robot.outputs,
    )  # fmt: skip


def _fault(robot: Robot, now_s: float, *, acting: bool) -> Verdict | None:
    judged = frame(robot, now_s)
    fault = cloud_fault(robot.situation, robot.link, judged, robot.judged_s(now_s), acting=acting)
    limits = (v for v in wishes.reported(robot) if v.reason.kind is Kind.LIMIT)
    return fault or next((Verdict(Site.ROBOT, v.reason, v.message) for v in limits), None)


def _move(robot: Robot, now_s: float, commands: list[Command]) -> Robot:
    able = robot.nodes_ready and _outputs_flow(robot, now_s)
    both_silent = robot.both_silent and not able
    fell_at_s = None if able else now_s if robot.fell_at_s is None else robot.fell_at_s
    if fell_at_s != robot.fell_at_s or both_silent is not robot.both_silent:
        robot = replace(robot, fell_at_s=fell_at_s, both_silent=both_silent)
    if robot.early.taken_s is not None and now_s >= robot.stalls.until_s:
        robot = early.judge(robot, _fault(robot, now_s, acting=False), now_s, commands)
    robot, verdict = wishes.wanted(robot, now_s)
    if robot.settings.mode is Mode.OBSERVE:
        return _observe_only(robot, verdict, now_s, commands)
    if robot.phase in (Phase.CLOUD, Phase.TO_ROBOT):
        return _move_from_cloud(robot, verdict, now_s, commands)
    if robot.phase is Phase.TO_CLOUD:
        return _move_to_cloud(robot, verdict, now_s, commands)
    if robot.phase is Phase.TAKEOVER and robot.nodes_ready:
        robot = replace(robot, phase=Phase.ROBOT)
    return _move_from_robot(robot, verdict, now_s, commands)


def _move_from_cloud(robot: Robot, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    fault = _fault(robot, now_s, acting=True)
    if fault is not None:
        return _take_over(robot, fault, now_s, commands)
    robot = early.prove(robot, now_s)
    fault = early.missed(robot)
    if fault is not None:
        return early.taken(_take_over(robot, fault, now_s, commands, by_silence=True), now_s)
    if robot.phase is Phase.CLOUD:
        dwelt = now_s - robot.charged_s >= robot.settings.min_dwell_s or verdict.reason.urgent
        if verdict.site is Site.ROBOT and dwelt and now_s >= robot.retry_s:
            robot, waits = handing.hold(robot, verdict, now_s)
            if waits:
                return robot
            return _prepare(robot, Phase.TO_ROBOT, verdict, now_s, commands)
        return robot
    preparation = robot.preparation
    assert preparation is not None
    armed = robot.nodes_ready and handing.may_arm(robot, preparation, verdict, now_s)
    robot = replace(robot, preparation=replace(preparation, armed=armed))
    robot, why = handing.interrupts(robot, verdict, now_s)
    if why is None and now_s >= preparation.deadline_s:
        message = "The robot's nodes did not get ready in time, the cloud goes on"
        why = Verdict(Site.CLOUD, Reason.ROBOT_NOT_READY, message)
        if robot.nodes_ready and not armed:
            why = handing.pending(robot, preparation) or why
    if why is not None:
        return _call_off(robot, Phase.CLOUD, why, now_s, commands)
    return robot


def _move_to_cloud(robot: Robot, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    fault = _fault(robot, now_s, acting=False)
    if fault is None and robot.link.peer != robot.partner:
        fault = Verdict(Site.ROBOT, Reason.CLOUD_RESTARTED, "Another incarnation of the cloud agent answers")
    if fault is None and verdict.site is Site.ROBOT and verdict.reason.urgent:
        fault = verdict
    preparation = robot.preparation
    assert preparation is not None
    report = robot.situation.report
    ready = report is not None and report.acting and report.epoch == preparation.candidate
    if fault is None:
        robot, fault = handing.interrupts(robot, verdict, now_s)
    if fault is None and now_s >= preparation.deadline_s:
        message = "The cloud's nodes did not get ready in time, the robot goes on"
        if preparation.armed:
            message = "The cloud's nodes got ready, its rated outputs were silent; the robot goes on"
            robot = replace(robot, both_silent=preparation.need)
        fault = Verdict(Site.ROBOT, Reason.CLOUD_NOT_READY, message)
        if ready and not preparation.armed:
            fault = handing.pending(robot, preparation) or fault
    if fault is not None:
        return _call_off(robot, Phase.ROBOT, fault, now_s, commands)
    armed = ready and handing.may_arm(robot, preparation, verdict, now_s)
    preparation = replace(preparation, armed=armed, offered=preparation.offered or armed)
    return replace(robot, preparation=preparation)


def _move_from_robot(robot: Robot, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    settings = robot.settings
    fault = _fault(robot, now_s, acting=False)
    if now_s < robot.stalls.until_s:  # what happened meanwhile is still to be read: nothing new is begun on old news
        return robot if fault is None or robot.phase is not Phase.ROBOT else _decide(robot, fault, now_s, commands)
    if fault is None and _in_need(robot, verdict, now_s):
        why = Verdict(Site.CLOUD, Reason.ROBOT_UNABLE, "The robot cannot act, the cloud can")
        robot = replace(robot, manual=None, leaving=None)  # whoever asked for the robot did not ask for a standstill
        return _prepare(robot, Phase.TO_CLOUD, why, now_s, commands)
    dwelt = now_s - robot.charged_s >= settings.min_dwell_s or verdict.reason.urgent
    held = verdict.reason.kind is Kind.PIN and now_s < robot.policy.hold_until_s
    free = dwelt and not held and now_s >= robot.retry_s and robot.duplicated
    if verdict.site is Site.CLOUD and fault is None and free:
        robot, waits = handing.hold(robot, verdict, now_s)
        if waits:
            return robot
        return _prepare(robot, Phase.TO_CLOUD, verdict, now_s, commands)
    chosen = verdict.site is Site.ROBOT and verdict.reason.chosen
    if robot.both_silent and not chosen:
        message = "Rated outputs are silent on the robot and in the cloud; the cloud is asked again less and less often"
        verdict = Verdict(Site.ROBOT, Reason.BOTH_SILENT, message)
    shown = verdict if fault is None or chosen else fault  # a broken limit says more than what the policy waits for
    return _decide(robot, shown, now_s, commands)


def _in_need(robot: Robot, verdict: Verdict, now_s: float) -> bool:
    """The robot has not been able to act for longer than its nodes may take, and the cloud may be asked (again).

    Retries grow, but not those of a robot that stands still: unless the cloud's outputs were as silent as the robot's.
    Then there may be nothing to do, and to wake the cloud's nodes each second would not help.
    """
    since_s = robot.fell_at_s
    if since_s is None or not robot.duplicated:
        return False
    if now_s - max(since_s, robot.charged_s) <= robot.settings.activation_deadline_s:
        return False
    if verdict.site is Site.ROBOT and not verdict.reason.yields_to_need:
        return False
    hurried_s = robot.retry_s if robot.both_silent else robot.since_s + RETRY_FIRST_S
    return now_s >= min(robot.retry_s, hurried_s)


def _observe_only(robot: Robot, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    fault = _fault(robot, now_s, acting=False)
    would = fault if fault is not None else verdict
    message = f"Observing only; would act on the {would.site.value}: {would.message}"
    return _decide(robot, Verdict(would.site, would.reason, message), now_s, commands)


def _outputs_flow(robot: Robot, now_s: float) -> bool:
    """The robot's rated outputs, as the collector hears them, are not silent (known only while the robot acts).

    Without a collector nothing reaches the consumers.
    """
    if site(robot) is Site.CLOUD:
        return True
    started_s = robot.started_us / 1e6
    gate, reported_s = robot.situation.gate, robot.situation.gate_s
    if now_s - (started_s if reported_s is None else reported_s) > robot.settings.lease_s:
        return now_s < robot.stalls.until_s and not _starved(robot, now_s)  # its reports may still be unread
    if now_s - max(robot.charged_s, started_s) < robot.settings.activation_deadline_s:
        return True
    return gate is not None and gate.robot_flows


def _outputs_heard(robot: Robot, now_s: float) -> bool:
    """The collector passes the robot and has seen a message of each rated output in time (while the robot acts).

    No grace counts, for pauses of whichever process or for a new charge, but for outputs that are slower than nodes
    wake: they speak one period after their side took over, and nobody waits for them.
    """
    if site(robot) is Site.CLOUD:
        return True
    gate, settings = robot.situation.gate, robot.settings
    reported_s = robot.situation.gate_s
    charged_for_s = now_s - max(robot.charged_s, robot.started_us / 1e6)
    due = {
        i
        for i, o in enumerate(robot.outputs)
        if o.rated and not settings.activation_deadline_s < o.deadline_s >= charged_for_s
    }
    if gate is not None:
        due -= set(gate.idle)
    if not due:
        return True
    if gate is None or reported_s is None or now_s - reported_s > settings.lease_s:
        return False
    passes = gate.charge is None or gate.charge.site is Site.ROBOT or gate.fell_back
    return passes and due <= set(gate.robot_flowing)


# -- changing ---------------------------------------------------------------------------------------------------------


def _prepare(robot: Robot, phase: Phase, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    candidate = robot.last_epoch + 1
    settings = robot.settings
    flow_s = max(PREPARE_EXTRA_S, robot.slowest_output_s) + REPORT_BEATS * settings.beat_period_s
    patient_until_s = now_s + settings.preparing_s
    need = verdict.reason.kind is Kind.NEED
    preparation = Preparation(candidate, patient_until_s + flow_s, need=need, patient_until_s=patient_until_s)
    robot = replace(robot, phase=phase, since_s=now_s, last_epoch=candidate, preparation=preparation)
    if phase is Phase.TO_CLOUD:
        robot = replace(robot, partner=robot.link.peer, situation=replace(robot.situation, good_s=None))
    return _decide(robot, verdict, now_s, commands, force=True)


def _enter(robot: Robot, charge: Charge, now_s: float, commands: list[Command]) -> Robot:
    """The collector has changed over to what was the candidate."""
    phase = Phase.CLOUD if charge.site is Site.CLOUD else Phase.ROBOT
    good_s = robot.situation.good_s
    robot = replace(
        robot, phase=phase, since_s=now_s, charged_s=now_s, epoch=charge.token.epoch, preparation=None,
        failures=0, retry_s=0.0, both_silent=False,
        situation=replace(robot.situation, good_s=now_s if good_s is None else good_s),
    )  # fmt: skip
    policy = robot.policy
    if phase is Phase.ROBOT:
        robot = replace(robot, clear_s=_clear_s(robot, now_s))
        if not robot.decided.reason.urgent:
            policy = policies.lost(policy, robot.settings, now_s)
    robot = replace(robot, policy=policies.entered(policy, charge.site, now_s))
    return _decide(robot, robot.decided, now_s, commands, force=True, switched=True)


def _call_off(robot: Robot, phase: Phase, why: Verdict, now_s: float, commands: list[Command]) -> Robot:
    """A preparation failed (unless a person or the clocks ended it): the old side goes on, the next attempt waits."""
    failed = not why.reason.urgent
    wait_s = min(RETRY_MAX_S, RETRY_FIRST_S * 2**robot.failures) if failed else 0.0
    epoch = robot.epoch
    if phase is Phase.ROBOT:  # the candidate may already be passing: only a newer epoch ends it for sure
        epoch = robot.last_epoch + 1
        robot = replace(robot, clear_s=_clear_s(robot, now_s))
    robot = replace(
        robot, phase=phase, since_s=now_s, epoch=epoch, last_epoch=max(epoch, robot.last_epoch),
        preparation=None, failures=robot.failures + failed, retry_s=now_s + wait_s,
    )  # fmt: skip
    return _decide(robot, why, now_s, commands, force=True)


def _take_over(
    robot: Robot, fault: Verdict, now_s: float, commands: list[Command], *, by_silence: bool = False
) -> Robot:
    """Sudden loss: the robot is in charge from now on; consumers hear nobody else.

    `by_silence`: of one message, which may come yet: sessions, wishes and what the policy has learned stay (early.py).
    """
    silent_s = None if robot.situation.good_s is None else now_s - robot.situation.good_s
    epoch = robot.last_epoch + 1
    phase = Phase.ROBOT if robot.nodes_ready else Phase.TAKEOVER
    policy = robot.policy if by_silence else policies.lost(robot.policy, robot.settings, now_s)
    policy = policies.entered(policy, Site.ROBOT, now_s)
    # A loss ends the wish for the cloud: it would take the hold-down's place and flap with the link.
    keeps = by_silence or (robot.manual is not None and robot.manual.site is Site.ROBOT)
    manual = robot.manual if keeps else None
    robot = replace(
        robot, phase=phase, since_s=now_s, charged_s=now_s, epoch=epoch, last_epoch=epoch, preparation=None,
        failures=0, both_silent=False, retry_s=0.0, manual=manual, clear_s=_clear_s(robot, now_s), policy=policy,
        situation=replace(robot.situation, good_s=None),
    )  # fmt: skip
    if not by_silence:
        commands.append(Reopen(fault.reason))
    return _decide(robot, fault, now_s, commands, force=True, switched=True, silent_s=silent_s)


def _decide(
    robot: Robot, verdict: Verdict, now_s: float, commands: list[Command], *,
    force: bool = False, switched: bool = False, silent_s: float | None = None,
) -> Robot:  # fmt: skip
    changed = (verdict.site, verdict.reason) != (robot.decided.site, robot.decided.reason)
    if not force and not (changed and now_s - robot.decided_s >= DECIDED_PERIOD_S):
        return robot
    commands.append(Decided(site(robot), robot.epoch, robot.phase, verdict, switched, silent_s))
    return replace(robot, decided=verdict, decided_s=now_s)


# -- levels -----------------------------------------------------------------------------------------------------------


def _tell(robot: Robot, now_s: float, commands: list[Command]) -> Robot:
    settings = robot.settings
    preparing_cloud = robot.phase is Phase.TO_CLOUD
    granted = preparing_cloud or site(robot) is Site.CLOUD
    epoch = robot.candidate if preparing_cloud else robot.epoch
    in_charge = site(robot) is Site.CLOUD
    cloud = robot.partner if granted else robot.link.peer
    armed = robot.preparation is not None and robot.preparation.armed
    gate_told = robot.situation.gate
    outputs_flow, outputs_heard = _outputs_flow(robot, now_s), _outputs_heard(robot, now_s)
    stop = next((v.message for v in wishes.reported(robot) if v.stops), "") if robot.vetoes else ""
    silent = () if gate_told is None else gate_told.names(gate_told.robot_silent, robot.outputs)
    cloud_while = _cloud_while(robot)
    # All that the three levels are made of: they are put together only when they are given out.
    levels = (
        epoch, granted, cloud, settings.lease_s, in_charge, robot.epoch, robot.candidate if armed else 0,
        robot.phase is Phase.CLOUD, outputs_flow, outputs_heard, stop, silent,
        robot.robot_while, cloud_while,
    )  # fmt: skip
    if levels == robot.levels and now_s - robot.levels_s < settings.beat_period_s - 1e-6:
        return robot
    lease_us = round(settings.lease_s * 1e6)
    permission = Permission(epoch, granted, cloud, lease_us, in_charge, presence=bool(cloud))
    following = _charge(robot, Site.CLOUD if preparing_cloud else Site.ROBOT, robot.candidate) if armed else None
    present = presence(robot.incarnation, cloud) if cloud else None
    current = _charge(robot, site(robot), robot.epoch)
    gate = Gate(
        robot.started_us, current, following, said_s=now_s, presence=present,
        robot_while=robot.robot_while, cloud_while=cloud_while,
    )  # fmt: skip
    acting = Acting(
        acting=robot.phase is not Phase.CLOUD,
        outputs_flow=outputs_flow,
        in_charge=site(robot) is Site.ROBOT,
        stop=stop,
        outputs_heard=outputs_heard,
        silent=silent,
    )
    commands += [Permit(permission), SetGate(gate), acting]
    return replace(robot, levels=levels, levels_s=now_s)


def _cloud_while(robot: Robot) -> tuple[int, ...]:
    """Returns the outputs whose `while` is true in the cloud, by its newest report."""
    report = robot.situation.report
    rated = 0 if report is None or report.serves != robot.incarnation else report.rated
    return tuple(i for i, o in enumerate(robot.outputs) if o.while_ is not None and rated >> i & 1)


def prepared(robot: Robot) -> Charge | None:
    """Returns the side that gets ready, and the token it does so under; None while none does."""
    if robot.preparation is None:
        return None
    side = Site.CLOUD if robot.phase is Phase.TO_CLOUD else Site.ROBOT
    return _charge(robot, side, robot.candidate)


def _charge(robot: Robot, side: Site, epoch: int) -> Charge:
    return Charge(side, Token(robot.incarnation, epoch, robot.partner if side is Site.CLOUD else ""))
