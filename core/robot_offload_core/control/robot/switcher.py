"""The placement machine of the robot's side: the robot has authority, because the actuators are there.

Phases: ROBOT (the robot acts), TO_CLOUD (it acts while the cloud gets ready under a candidate epoch), CLOUD,
TO_ROBOT (the cloud acts while the robot's nodes activate), TAKEOVER (the robot is in charge after a sudden loss, its
CORE nodes still activate). Every changeover, even one that is called off, uses a new epoch, so that the collector never
has to go back. What the shell keeps up (permission, gate, acting) is a level, repeated every beat period.
"""

from __future__ import annotations

from robot_offload_core.control.robot import changeovers, fast_takeover, levels, readiness, requests, stalls
from robot_offload_core.control.robot.health import Circumstances, is_good
from robot_offload_core.control.robot.limits import cloud_fault
from robot_offload_core.control.robot.placement import (
    IN_CHARGE,
    Answer,
    CloudBeat,
    CloudLeaving,
    Command,
    Event,
    GateReported,
    NodesReported,
    Preparation,
    RelayReported,
    Robot,
    SetPin,
    SetSettings,
    SwitchByHand,
    Vetoed,
    WhileReported,
    Wish,
)
from robot_offload_core.control.robot.settling import meanwhile
from robot_offload_core.fence import grant
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site
from robot_offload_core.link import links, policies
from robot_offload_core.words import slow_outputs
from robot_offload_core.words.beats import CloudReport
from robot_offload_core.words.checks import require
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import DataReported, StateReported, Tick, assert_never
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.messages import PulseSent
from robot_offload_core.words.reasons import Kind, Reason, Verdict
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Mode, Settings


def step(robot: Robot, event: Event, now_s: float) -> tuple[Robot, list[Command]]:
    """Take one event, decide, and send the levels if they changed or a beat period has passed."""
    commands: list[Command] = []
    before = robot
    robot = stalls.notice(robot, now_s)
    robot = _take(robot, event, now_s, commands)
    if robot.asked is not None:
        robot = _settle(robot, robot.asked, now_s)
    robot = _move(robot, now_s, commands)
    robot = levels.give_out(robot, now_s, commands)
    check(before, robot, event)
    return robot, commands


def check(before: Robot, after: Robot, event: Event) -> None:
    """Raise InvariantError if the step from `before` to `after` broke an invariant."""
    preparing = after.phase in (Phase.TO_CLOUD, Phase.TO_ROBOT)
    changed = site(after) is not site(before)
    require(
        "switcher",
        event,
        (after.epoch >= before.epoch, "the epoch fell"),
        (after.last_epoch >= max(before.last_epoch, after.epoch, after.candidate), "an epoch was used beyond the last"),
        (not changed or after.epoch > before.epoch, "the side in charge changed within one epoch"),
        (after.grant.site is site(after), "the phase and the grant name different sides"),
        ((after.preparation is not None) is preparing, "a preparation exactly while a side gets ready"),
        ((after.candidate > 0) is preparing, "a candidate exactly while a side gets ready"),
        (not preparing or after.candidate > after.epoch, "the candidate is not newer than who is in charge"),
        (after.partner != "" or (site(after) is Site.ROBOT and not preparing), "the cloud is addressed by no name"),
        (after.incarnation == before.incarnation, "the incarnation changed"),
    )


def site(robot: Robot) -> Site:
    """Return the side in charge."""
    return IN_CHARGE[robot.phase]


def effects_site(robot: Robot, now_s: float) -> Site | None:
    """Return the side whose effects that are not collected are admitted now; None while the other might still act."""
    return grant.effects(robot.grant, now_s)


def _settle(robot: Robot, asked: Settings, now_s: float) -> Robot:
    """Apply changed settings, all of them once the cloud has certainly stopped."""
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
            slow = slow_outputs.wake(robot.slow, event.asleep, now_s)
            robot = replace(robot, nodes_ready=event.ready, duplicated=event.duplicated, hot=event.hot, slow=slow)
        case WhileReported():
            robot = replace(robot, robot_while=event.outputs)
        case Vetoed():
            robot = requests.forbid(robot, event, now_s)
        case SetPin():
            robot = replace(robot, pin=event.pin)
        case CloudLeaving():
            robot = replace(robot, leaving=event)
        case SetSettings():
            robot = replace(robot, asked=event.settings, inputs=event.inputs)
        case RelayReported() | StateReported():
            robot = replace(robot, handing=readiness.told(robot.handing, event))
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
    if not links.is_news(link, beat):
        return robot  # a copy, late or doubled: what it reports is past
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
    slow = slow_outputs.see(robot.slow, report.robot_flowing, now_s)
    robot = replace(robot, situation=replace(robot.situation, gate=report, gate_s=now_s), slow=slow)
    if report.charge is None:
        return robot
    # Also after a preparation was called off: the collector may have changed over just before it heard of that.
    entered = grant.entered(robot.grant, report.charge, now_s, changeovers.stopped_s(robot.settings))
    return robot if entered is robot.grant else changeovers.enter(robot, entered, now_s, commands)


def _by_hand(robot: Robot, asked: Site, now_s: float) -> tuple[Robot, bool, str]:
    pin = requests.pin(robot, now_s)
    if robot.settings.mode is Mode.OBSERVE:
        return robot, False, "Refused (Observe): this agent only observes; set mode to Auto"
    if pin is not None and pin is not asked:
        return robot, False, f"Refused (Pinned): placement is pinned to the {pin.value}; clear the pin first"
    if asked is Site.CLOUD and IN_CHARGE[robot.phase] is Site.ROBOT:
        fault = _fault(robot, now_s, acting=False)
        fault = fault or requests.veto(robot, now_s)
        if fault is not None:
            return robot, False, f"Refused ({fault.reason}): {fault.message}"
    robot = replace(robot, manual=Wish(asked, now_s + robot.settings.manual_hold_s))
    if IN_CHARGE[robot.phase] is asked and robot.phase not in (Phase.TO_CLOUD, Phase.TO_ROBOT):
        return robot, True, f"The {asked.value} is in charge already"
    return robot, True, f"Switching to the {asked.value}"


# -- deciding ---------------------------------------------------------------------------------------------------------


def frame(robot: Robot, now_s: float) -> Circumstances:
    """Return the values against which the situation is judged."""
    return Circumstances(
        robot.incarnation, robot.partner, robot.epoch, robot.settings, robot.inputs, robot.stalls.until_s,
        stalls.starved(robot, now_s), robot.outputs, robot.shape,
    )  # fmt: skip


def _fault(robot: Robot, now_s: float, *, acting: bool) -> Verdict | None:
    judged = frame(robot, now_s)
    fault = cloud_fault(robot.situation, robot.link, judged, robot.judged_s(now_s), acting=acting)
    limits = requests.limits(robot, now_s, acting=acting)
    return fault or next((Verdict(Site.ROBOT, v.reason, v.message) for v in limits), None)


def _move(robot: Robot, now_s: float, commands: list[Command]) -> Robot:
    able = robot.nodes_ready and levels.outputs_flow_now(robot, now_s)
    both_silent = robot.both_silent and not able
    fell_at_s = None if able else now_s if robot.fell_at_s is None else robot.fell_at_s
    if fell_at_s != robot.fell_at_s or both_silent is not robot.both_silent:
        robot = replace(robot, fell_at_s=fell_at_s, both_silent=both_silent)
    if robot.early.taken_s is not None and now_s >= robot.stalls.until_s:
        robot = fast_takeover.judge(robot, _fault(robot, now_s, acting=False), now_s, commands)
    robot, verdict = requests.wanted(robot, now_s)
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
        return changeovers.take_over(robot, fault, now_s, commands)
    robot = fast_takeover.prove(robot, now_s)
    fault = fast_takeover.missed(robot)
    if fault is not None:
        return fast_takeover.taken(changeovers.take_over(robot, fault, now_s, commands, by_silence=True), now_s)
    if robot.phase is Phase.CLOUD:
        dwelt = now_s - robot.charged_s >= robot.settings.min_dwell_s or verdict.reason.urgent
        if verdict.site is Site.ROBOT and dwelt and now_s >= robot.retry_s:
            robot, waits = readiness.hold(robot, verdict, now_s)
            robot, lacks = readiness.begins(robot, verdict, now_s)
            if waits or lacks is not None:
                return robot
            return changeovers.prepare(robot, Phase.TO_ROBOT, verdict, now_s, commands)
        return robot if verdict.site is Site.ROBOT else readiness.content(robot)
    preparation = robot.preparation
    assert preparation is not None
    armed = robot.nodes_ready and readiness.may_arm(robot, preparation, verdict, now_s)
    prompt = preparation.prompt or verdict.reason.kind is Kind.VETO  # whatever it was begun for
    robot = _armed(robot, replace(preparation, armed=armed, prompt=prompt))
    robot, why = readiness.interrupts(robot, verdict, now_s)
    if why is None and now_s >= preparation.deadline_s:
        message = "The robot's nodes did not get ready in time, the cloud goes on"
        why = Verdict(Site.CLOUD, Reason.ROBOT_NOT_READY, message)
        if robot.nodes_ready and not armed:
            why = readiness.pending(robot, preparation) or why
    if why is not None:
        return changeovers.call_off(robot, Phase.CLOUD, why, now_s, commands)
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
    ready = report is not None and report.acting and report.epoch == robot.candidate
    if fault is None:
        robot, fault = readiness.interrupts(robot, verdict, now_s)
    if fault is None and now_s >= preparation.deadline_s:
        message = "The cloud's nodes did not get ready in time, the robot goes on"
        if preparation.armed:
            message = "The cloud's nodes got ready, its rated outputs were silent; the robot goes on"
            robot = replace(robot, both_silent=preparation.need)
        fault = Verdict(Site.ROBOT, Reason.CLOUD_NOT_READY, message)
        if ready and not preparation.armed:
            fault = readiness.pending(robot, preparation) or fault
    if fault is not None:
        return changeovers.call_off(robot, Phase.ROBOT, fault, now_s, commands)
    if _unable(robot, now_s):
        preparation = replace(preparation, need=True, prompt=True)  # whatever it was begun for
    armed = ready and readiness.may_arm(robot, preparation, verdict, now_s)
    return _armed(robot, replace(preparation, armed=armed))


def _armed(robot: Robot, preparation: Preparation) -> Robot:
    """Return the robot with a preparation; one that is armed is offered to the collector."""
    offered = grant.offer(robot.grant) if preparation.armed else robot.grant
    return replace(robot, preparation=preparation, grant=offered)


def _move_from_robot(robot: Robot, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    settings = robot.settings
    fault = _fault(robot, now_s, acting=False)
    if now_s < robot.stalls.until_s:  # what happened meanwhile is still to be read: nothing new is begun on old news
        return (
            robot
            if fault is None or robot.phase is not Phase.ROBOT
            else changeovers.decide(robot, fault, now_s, commands)
        )
    if fault is None and _in_need(robot, verdict, now_s):
        why = Verdict(Site.CLOUD, Reason.ROBOT_UNABLE, "The robot cannot act, the cloud can")
        robot = replace(robot, manual=None, leaving=None)  # whoever asked for the robot did not ask for a standstill
        return changeovers.prepare(robot, Phase.TO_CLOUD, why, now_s, commands)
    dwelt = now_s - robot.charged_s >= settings.min_dwell_s or verdict.reason.urgent
    held = verdict.reason.kind is Kind.PIN and now_s < robot.policy.hold_until_s
    free = dwelt and not held and now_s >= robot.retry_s and robot.duplicated
    if verdict.site is Site.CLOUD and fault is None and free:
        robot, waits = readiness.hold(robot, verdict, now_s)
        robot, lacks = readiness.begins(robot, verdict, now_s)
        if waits:
            return robot
        if lacks is not None:
            return changeovers.decide(robot, lacks, now_s, commands)
        return changeovers.prepare(robot, Phase.TO_CLOUD, verdict, now_s, commands)
    if verdict.site is Site.ROBOT:
        robot = readiness.content(robot)
    chosen = verdict.site is Site.ROBOT and verdict.reason.chosen
    if robot.both_silent and not chosen:
        message = "Rated outputs are silent on the robot and in the cloud; the cloud is asked again less and less often"
        verdict = Verdict(Site.ROBOT, Reason.BOTH_SILENT, message)
    shown = verdict if fault is None or chosen else fault  # a broken limit says more than what the policy waits for
    return changeovers.decide(robot, shown, now_s, commands)


def _in_need(robot: Robot, verdict: Verdict, now_s: float) -> bool:
    """Return whether the robot was unable to act for longer than its nodes may take, and may ask the cloud (again).

    Waits between retries grow, but for a robot that stands still only if the cloud's outputs were as silent as its own.
    Then there may be nothing to do, and activating the cloud's nodes every second would not help.
    """
    if not _unable(robot, now_s) or not robot.duplicated:
        return False
    if verdict.site is Site.ROBOT and not verdict.reason.yields_to_need:
        return False
    hurried_s = robot.retry_s if robot.both_silent else robot.since_s + changeovers.RETRY_FIRST_S
    return now_s >= min(robot.retry_s, hurried_s)


def _unable(robot: Robot, now_s: float) -> bool:
    """Return whether the robot has not been able to act for longer than its nodes may take."""
    since_s = robot.fell_at_s
    return since_s is not None and now_s - max(since_s, robot.charged_s) > robot.settings.activation_deadline_s


def _observe_only(robot: Robot, verdict: Verdict, now_s: float, commands: list[Command]) -> Robot:
    fault = _fault(robot, now_s, acting=False)
    would = fault if fault is not None else verdict
    message = f"Observing only; would act on the {would.site.value}: {would.message}"
    return changeovers.decide(robot, Verdict(would.site, would.reason, message), now_s, commands)


# -- levels -----------------------------------------------------------------------------------------------------------


def prepared(robot: Robot) -> Charge | None:
    """Return the side that gets ready, and the token it does so under; None while none does."""
    return grant.preparing(robot.grant)
