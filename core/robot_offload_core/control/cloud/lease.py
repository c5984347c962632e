"""The cloud's side: it acts only while it holds a lease of the current epoch, anchored to its own clock.

What a heartbeat grants and what may leave is decided by the fence (`fence.lease`). Here it is decided which robot is
served, when a pause of this process or host voids everything, and what is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence import lease
from robot_offload_core.fence.lease import Granted, Lease
from robot_offload_core.fence.token import Token
from robot_offload_core.words.beats import Beat, CloudReport, Permission
from robot_offload_core.words.checks import require
from robot_offload_core.words.events import Acting, CloudData, SetEgress, Tick, assert_never
from robot_offload_core.words.reasons import Explained
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Settings


class Stand(Explained):
    """The situation of the cloud's side."""

    ASLEEP = "Asleep", "The robot acts, or no robot is heard"
    WAKING = "Waking", "The cloud holds a lease and brings up its nodes"
    ACTING = "Acting", "The cloud holds a lease and its nodes are ready"
    LEASE_EXPIRED = "LeaseExpired", "The lease has run out and no new grant came", "Look at the link"
    DUPLICATE_IDENTITY = (
        "DuplicateIdentity", "A second robot of this identity is heard and refused", "Give each robot its own bundle"
    )  # fmt: skip


@dataclass(frozen=True)
class Cloud:
    """State of the cloud's control process. Times on its own steady clock, seconds.

    Attributes:
        lease: what the robot has granted, see the fence.
        settings: shared with the robot.
        robot_s: arrival of the newest beat of the robot served.
        robot_sent_us: send time of its newest beat, on its clock.
        ready: all duplicated CORE nodes here are Active.
        data_age_s: time since the data session last heard the robot; None never.
        input_ages_s: newest accepted ages of required inputs; None never.
        rated: see CloudData.
        refused: incarnation of a second robot; "" for none.
        refused_s: when that robot was last heard.
        stepped_s: time of the last step.
        reported: the last decision reported, to report each once.
    """

    lease: Lease
    settings: Settings
    robot_s: float = 0.0
    robot_sent_us: int = -1
    ready: bool = False
    data_age_s: float | None = None
    input_ages_s: tuple[float | None, ...] = ()
    rated: int = 0
    refused: str = ""
    refused_s: float = 0.0
    stepped_s: float | None = None
    reported: Stand = Stand.ASLEEP

    @property
    def incarnation(self) -> str:
        """Return the incarnation of this control process."""
        return self.lease.cloud

    @property
    def robot(self) -> str:
        """Return the incarnation of the robot served; "" for none."""
        return self.lease.robot

    @property
    def epoch(self) -> int:
        """Return the newest epoch that the robot has named."""
        return self.lease.epoch


def start(incarnation: str, settings: Settings) -> Cloud:
    """Return the state of a control process that serves no robot yet."""
    return Cloud(lease.start(incarnation), settings)


@dataclass(frozen=True)
class RobotBeat:
    """The pulse process reported a beat of a robot."""

    beat: Beat
    arrived_s: float


@dataclass(frozen=True)
class CloudNodes:
    """The guardian's view of the cloud's replicas."""

    ready: bool


Event = RobotBeat | CloudNodes | CloudData | Tick


@dataclass(frozen=True)
class SetReport:
    """Level to the pulse process: this side's part of the beat."""

    report: CloudReport


@dataclass(frozen=True)
class StandChanged:
    """For the log and diagnostics: reason and message of a change."""

    reason: Stand
    message: str


Command = SetEgress | Acting | SetReport | StandChanged


def step(cloud: Cloud, event: Event, now_s: float) -> tuple[Cloud, list[Command]]:
    """Take one event; return the next state and the levels that the shell keeps up.

    Every step returns the three levels (egress, acting, report), so a lost message does no harm.
    """
    before = cloud
    cloud = _notice_pause(cloud, now_s)
    match event:
        case RobotBeat():
            cloud = _hear(cloud, event.beat, event.arrived_s, now_s)
        case CloudNodes():
            cloud = replace(cloud, ready=event.ready)
        case CloudData():
            cloud = replace(cloud, data_age_s=event.age_s, input_ages_s=event.input_ages_s, rated=event.rated)
        case Tick():
            pass
        case _:
            assert_never(event)
    cloud = _forget(cloud, now_s)
    commands: list[Command] = [*_levels(cloud, now_s)]
    reason, message = situation(cloud, now_s)
    if reason != cloud.reported:
        cloud = replace(cloud, reported=reason)
        commands.append(StandChanged(reason, message))
    check(before, cloud, event, now_s)
    return cloud, commands


def check(before: Cloud, after: Cloud, event: Event, now_s: float) -> None:
    """Raise InvariantError when the step from `before` to `after` broke what every step must keep."""
    same, held, longest_s = after.robot == before.robot, after.lease, now_s + after.settings.lease_s
    require(
        "lease",
        event,
        (not same or after.epoch >= before.epoch, "the epoch fell"),
        (held.granted or held.end_s == 0.0, "a lease without a grant"),
        (not held.granted or after.robot != "", "a grant of nobody"),
        (held.end_s <= longest_s, "the lease is longer than a lease from now"),
        (held.presence_end_s <= longest_s, "presence is longer than a lease from now"),
        (held.presence_end_s == 0.0 or after.robot != "", "presence for nobody"),
        (same or not holds_lease(before, now_s), "another robot is served while a lease is held"),
    )


def holds_lease(cloud: Cloud, now_s: float) -> bool:
    """Return whether a lease of the current epoch is valid now."""
    return lease.holds(cloud.lease, now_s)


def called_off(before: Cloud, after: Cloud) -> bool:
    """Return whether the robot has ended a preparation of this side, which was ready and never in charge."""
    prepared = before.lease.granted and before.ready and not before.lease.in_charge
    return prepared and not after.lease.granted and after.robot == before.robot and after.epoch > before.epoch


def situation(cloud: Cloud, now_s: float) -> tuple[Stand, str]:
    """Return (reason, message) for the situation of this side."""
    if cloud.refused:
        return Stand.DUPLICATE_IDENTITY, f"A second robot of this identity is refused: {cloud.refused[:8]}"
    if holds_lease(cloud, now_s):
        if cloud.ready:
            return Stand.ACTING, f"Acting under epoch {cloud.epoch}"
        return Stand.WAKING, f"Bringing up the nodes for epoch {cloud.epoch}"
    if cloud.lease.granted:
        return Stand.LEASE_EXPIRED, f"The lease of epoch {cloud.epoch} has run out"
    return Stand.ASLEEP, "The robot acts" if cloud.robot else "No robot is heard"


def _notice_pause(cloud: Cloud, now_s: float) -> Cloud:
    if cloud.stepped_s is not None and now_s - cloud.stepped_s > cloud.settings.pause_s:
        cloud = replace(cloud, lease=lease.void(cloud.lease, now_s))
    return replace(cloud, stepped_s=now_s)


def _hear(cloud: Cloud, beat: Beat, arrived_s: float, now_s: float) -> Cloud:
    if beat.incarnation != cloud.robot:
        if cloud.robot and (now_s - cloud.robot_s <= cloud.settings.robot_live_s or holds_lease(cloud, now_s)):
            return replace(cloud, refused=beat.incarnation, refused_s=now_s)
        cloud = replace(cloud, lease=lease.serve(cloud.lease, beat.incarnation, now_s), robot_sent_us=-1)
    if beat.sent_us <= cloud.robot_sent_us:
        return cloud
    cloud = replace(cloud, robot_s=max(cloud.robot_s, arrived_s), robot_sent_us=beat.sent_us)
    permission = beat.body
    if not isinstance(permission, Permission):
        return cloud
    return replace(cloud, lease=lease.hear(cloud.lease, _granted(cloud, beat, permission), now_s))


def _granted(cloud: Cloud, beat: Beat, permission: Permission) -> Granted:
    """Return what a permission grants, anchored to the beat of ours that it echoes."""
    echo = beat.echo
    echo_s = echo.sent_us / 1e6 if echo is not None and echo.incarnation == cloud.incarnation else None
    return Granted(
        Token(beat.incarnation, permission.epoch, permission.cloud), permission.granted, permission.in_charge,
        permission.presence, echo_s, min(cloud.settings.lease_s, permission.lease_us / 1e6),
    )  # fmt: skip


def _forget(cloud: Cloud, now_s: float) -> Cloud:
    if cloud.refused and now_s - cloud.refused_s > cloud.settings.robot_live_s:
        cloud = replace(cloud, refused="")
    if cloud.robot and now_s - cloud.robot_s > cloud.settings.robot_live_s:
        cloud = replace(cloud, lease=lease.serve(cloud.lease, "", now_s))
    return cloud


def _levels(cloud: Cloud, now_s: float) -> list[Command]:
    held = holds_lease(cloud, now_s)
    report = CloudReport(
        serves=cloud.robot,
        epoch=cloud.epoch,
        acting=held and cloud.ready,
        ready=cloud.ready,
        refused=cloud.refused,
        data_age_us=_us(cloud.data_age_s),
        input_ages_us=tuple(map(_us, cloud.input_ages_s)),
        rated=cloud.rated,
    )
    may = lease.leave(cloud.lease, now_s)
    egress = SetEgress(may.token, may.lease_end_s, may.in_charge, may.presence, may.presence_end_s)
    return [egress, Acting(held), SetReport(report)]


def _us(age_s: float | None) -> int:
    """Return microseconds; -1 for never, or for an unbounded age (the sender had not heard us)."""
    return -1 if age_s is None or age_s == float("inf") else max(0, round(age_s * 1e6))
