"""The side wanted by each source: people, the resource, the clocks, the cloud's end, the policy."""

from __future__ import annotations

from collections.abc import Iterator

from robot_offload_core.control.robot import readiness
from robot_offload_core.control.robot.health import clock_fault, fitness
from robot_offload_core.control.robot.placement import IN_CHARGE, Robot, Veto, Vetoed
from robot_offload_core.fence.token import Site
from robot_offload_core.link import policies
from robot_offload_core.words.reasons import Kind, Reason, Verdict
from robot_offload_core.words.replace import replace


def pin(robot: Robot, now_s: float) -> Site | None:
    """Return the side pinned on the robot, else the one pinned in the resource."""
    if robot.pin is not None and robot.pin.holds(now_s):
        return robot.pin.site
    return robot.settings.pin


def reported(robot: Robot) -> Iterator[Veto]:
    """Yield the findings of other processes that forbid the cloud."""
    for vetoed in robot.vetoes:
        yield from (v for v in vetoed.vetoes if v.reason.forbids and not v.of_robot)


def stop(robot: Robot) -> str:
    """Return why the driver is to be stopped whichever side acts; "" if it is not."""
    acts = IN_CHARGE[robot.phase] is Site.ROBOT
    found = (veto for vetoed in robot.vetoes for veto in vetoed.vetoes if veto.stops)
    return next((veto.message for veto in found if acts or not veto.of_robot), "")


def forbid(robot: Robot, vetoed: Vetoed, now_s: float) -> Robot:
    """Return the robot with the newest vetoes of one source, and with the time since one that hardens holds."""
    others = tuple(v for v in robot.vetoes if v.source != vetoed.source)
    robot = replace(robot, vetoes=(*others, vetoed) if vetoed.vetoes else others)
    if not any(v.reason.hardens for v in reported(robot)):
        return replace(robot, forbidden_s=None)
    return robot if robot.forbidden_s is not None else replace(robot, forbidden_s=now_s)


def limits(robot: Robot, now_s: float, *, acting: bool) -> Iterator[Veto]:
    """Yield the findings of others that are hard limits now, including a veto that the robot could not obey in time.

    Args:
        robot: state of the placement machine.
        now_s: on the robot's steady clock.
        acting: the cloud is in charge, so that there is a veto to obey.
    """
    since_s = robot.forbidden_s
    overdue = acting and since_s is not None and now_s - since_s >= robot.settings.activation_deadline_s
    for found in reported(robot):
        if found.reason.kind is Kind.LIMIT or (overdue and found.reason.hardens):
            yield found


def veto(robot: Robot, now_s: float) -> Verdict | None:
    """Return what forbids the cloud regardless of any request, besides the hard limits."""
    fault = clock_fault(robot.link, robot.settings)
    leaving = robot.leaving
    if fault is None and leaving is not None and leaving.cloud == robot.link.peer and now_s < leaving.until_s:
        message = "The cloud's pods are stopping, the robot acts until they are back"
        return Verdict(Site.ROBOT, Reason.POD_STOPPING, message)
    found = (v for v in reported(robot) if v.reason.kind is Kind.VETO)
    return fault or next((Verdict(Site.ROBOT, v.reason, v.message) for v in found), None)


def wanted(robot: Robot, now_s: float) -> tuple[Robot, Verdict]:
    """Choose by precedence: vetoes > pin on the robot > pin in the resource > by hand > policy."""
    fit = fitness(robot.link, robot.settings, robot.judged_s(now_s))
    policy, verdict = policies.decide(robot.policy, IN_CHARGE[robot.phase], fit, robot.settings, now_s)
    robot = replace(robot, policy=policy)
    forbidden = veto(robot, now_s)
    if forbidden is not None:
        return robot, forbidden
    pinned = pin(robot, now_s)
    if pinned is not None:
        reason = Reason.PINNED_TO_ROBOT if pinned is Site.ROBOT else Reason.PINNED_TO_CLOUD
        return robot, Verdict(pinned, reason, f"Placement is pinned to the {pinned.value}")
    if robot.manual is not None and robot.manual.holds(now_s):
        asked = robot.manual.site
        return robot, Verdict(asked, Reason.BY_HAND, f"The {asked.value} was asked for by hand")
    lacking = readiness.lacking(robot)
    if verdict.site is Site.CLOUD and lacking is not None and IN_CHARGE[robot.phase] is Site.ROBOT:
        return robot, lacking
    return robot, verdict
