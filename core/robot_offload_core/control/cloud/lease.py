"""The cloud's side: acts only while it holds a lease of the current epoch, anchored to its own clock.

A grant echoes a beat of this side; the lease ends at the send time of *that* beat plus the lease, so a grant that
waited in a buffer is worth nothing. A grant with a newer epoch ends the older one at once. A pause of the own process
or host voids everything until a grant echoes a beat that was sent after the pause.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Token, presence
from robot_offload_core.words.beats import Beat, CloudReport, Permission
from robot_offload_core.words.checks import require
from robot_offload_core.words.events import Acting, CloudData, SetEgress, Tick, assert_never
from robot_offload_core.words.reasons import Explained
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import Settings


class Stand(Explained):
    """What the cloud's side does."""

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
        incarnation: ours.
        settings: shared with the robot.
        robot: incarnation served; "" for none.
        robot_s: arrival of its newest beat.
        robot_sent_us: send time of its newest beat, on its clock.
        epoch: newest that it has named to us.
        granted: that epoch came with a grant.
        in_charge: the grant says that this side is in charge, not only that it is to get ready.
        lease_end_s: end of the lease of that epoch.
        presence_end_s: until when the nodes with placement Cloud may speak to the robot served, whoever is in charge.
        ready: all duplicated CORE nodes here are Active.
        data_age_s: since the data session last heard the robot; None never.
        input_ages_s: newest accepted ages of required inputs; None never.
        rated: see CloudData.
        refused: incarnation of a second robot; "" for none.
        refused_s: when it was last heard.
        stepped_s: time of the last step.
        void_before_s: echoes of beats sent before this grant nothing.
        reported: the last decision told, to tell each once.
    """

    incarnation: str
    settings: Settings
    robot: str = ""
    robot_s: float = 0.0
    robot_sent_us: int = -1
    epoch: int = 0
    granted: bool = False
    in_charge: bool = False
    lease_end_s: float = 0.0
    presence_end_s: float = 0.0
    ready: bool = False
    data_age_s: float | None = None
    input_ages_s: tuple[float | None, ...] = ()
    rated: int = 0
    refused: str = ""
    refused_s: float = 0.0
    stepped_s: float | None = None
    void_before_s: float = 0.0
    reported: Stand = Stand.ASLEEP


@dataclass(frozen=True)
class RobotBeat:
    """A beat of a robot arrived, as told by the pulse process."""

    beat: Beat
    arrived_s: float


@dataclass(frozen=True)
class CloudNodes:
    """The guardian's view of the cloud's replicas."""

    ready: bool


Event = RobotBeat | CloudNodes | CloudData | Tick


@dataclass(frozen=True)
class SetReport:
    """To the pulse process: this side's part of the beat."""

    report: CloudReport


@dataclass(frozen=True)
class StandChanged:
    """For the log and diagnostics: reason and message of a change."""

    reason: Stand
    message: str


Command = SetEgress | Acting | SetReport | StandChanged


def step(cloud: Cloud, event: Event, now_s: float) -> tuple[Cloud, list[Command]]:
    """Take in one event; return the next state and the level of everything the shell keeps up.

    The three levels (egress, acting, report) come with every step: losing one message of them loses nothing.
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
    same = after.robot == before.robot
    require(
        "lease",
        event,
        (not same or after.epoch >= before.epoch, "the epoch fell"),
        (after.granted or after.lease_end_s == 0.0, "a lease without a grant"),
        (not after.granted or after.robot != "", "a grant of nobody"),
        (after.lease_end_s <= now_s + after.settings.lease_s, "the lease is longer than a lease from now"),
        (after.presence_end_s <= now_s + after.settings.lease_s, "presence is longer than a lease from now"),
        (after.presence_end_s == 0.0 or after.robot != "", "presence for nobody"),
        (same or not holds_lease(before, now_s), "another robot is served while a lease is held"),
    )


def holds_lease(cloud: Cloud, now_s: float) -> bool:
    """Return whether a lease of the current epoch is valid now."""
    return cloud.granted and now_s < cloud.lease_end_s


def called_off(before: Cloud, after: Cloud) -> bool:
    """Return whether the robot has ended a preparation of this side, which was ready and never in charge."""
    prepared = before.granted and before.ready and not before.in_charge
    return prepared and not after.granted and after.robot == before.robot and after.epoch > before.epoch


def token(cloud: Cloud) -> Token:
    """Return the token that this side would act under."""
    return Token(cloud.robot, cloud.epoch, cloud.incarnation)


def situation(cloud: Cloud, now_s: float) -> tuple[Stand, str]:
    """Return (reason, message) of what this side does."""
    if cloud.refused:
        return Stand.DUPLICATE_IDENTITY, f"A second robot of this identity is refused: {cloud.refused[:8]}"
    if holds_lease(cloud, now_s):
        if cloud.ready:
            return Stand.ACTING, f"Acting under epoch {cloud.epoch}"
        return Stand.WAKING, f"Bringing up the nodes for epoch {cloud.epoch}"
    if cloud.granted:
        return Stand.LEASE_EXPIRED, f"The lease of epoch {cloud.epoch} has run out"
    return Stand.ASLEEP, "The robot acts" if cloud.robot else "No robot is heard"


def _notice_pause(cloud: Cloud, now_s: float) -> Cloud:
    if cloud.stepped_s is not None and now_s - cloud.stepped_s > cloud.settings.pause_s:
        cloud = replace(cloud, lease_end_s=0.0, presence_end_s=0.0, void_before_s=now_s)
    return replace(cloud, stepped_s=now_s)


def _hear(cloud: Cloud, beat: Beat, arrived_s: float, now_s: float) -> Cloud:
    if beat.incarnation != cloud.robot:
        if cloud.robot and (now_s - cloud.robot_s <= cloud.settings.robot_live_s or holds_lease(cloud, now_s)):
            return replace(cloud, refused=beat.incarnation, refused_s=now_s)
        cloud = replace(
            cloud, robot=beat.incarnation, robot_sent_us=-1, epoch=0, granted=False, in_charge=False, lease_end_s=0.0,
            presence_end_s=0.0,
        )  # fmt: skip
    if beat.sent_us <= cloud.robot_sent_us:
        return cloud
    cloud = replace(cloud, robot_s=max(cloud.robot_s, arrived_s), robot_sent_us=beat.sent_us)
    permission = beat.body
    if not isinstance(permission, Permission) or permission.cloud != cloud.incarnation:
        return cloud
    if permission.epoch < cloud.epoch:
        return cloud
    if permission.epoch > cloud.epoch:
        cloud = replace(cloud, epoch=permission.epoch, granted=False, in_charge=False, lease_end_s=0.0)
    if permission.granted:
        cloud = replace(cloud, granted=True, in_charge=permission.in_charge)
    return _renew(cloud, beat, permission, now_s)


def _renew(cloud: Cloud, beat: Beat, permission: Permission, now_s: float) -> Cloud:
    """Renew what a permission grants, anchored to our own beat that it echoes."""
    echo = beat.echo
    if echo is None or echo.incarnation != cloud.incarnation:
        return cloud
    if not cloud.void_before_s <= echo.sent_us / 1e6 <= now_s:  # from before a pause, or of a beat that is still unsent
        return cloud
    end_s = echo.sent_us / 1e6 + min(cloud.settings.lease_s, permission.lease_us / 1e6)
    if permission.granted or permission.presence:
        cloud = replace(cloud, presence_end_s=max(cloud.presence_end_s, end_s))
    return replace(cloud, lease_end_s=max(cloud.lease_end_s, end_s)) if permission.granted else cloud


def _unserved(cloud: Cloud) -> Cloud:
    return replace(cloud, epoch=0, granted=False, in_charge=False, lease_end_s=0.0, presence_end_s=0.0)


def _forget(cloud: Cloud, now_s: float) -> Cloud:
    if cloud.refused and now_s - cloud.refused_s > cloud.settings.robot_live_s:
        cloud = replace(cloud, refused="")
    if cloud.robot and now_s - cloud.robot_s > cloud.settings.robot_live_s and not holds_lease(cloud, now_s):
        cloud = replace(_unserved(cloud), robot="")
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
    egress = SetEgress(token(cloud), cloud.lease_end_s, cloud.in_charge) if held else SetEgress(None, 0.0)
    if now_s < cloud.presence_end_s:
        present = presence(cloud.robot, cloud.incarnation)
        egress = replace(egress, presence=present, presence_end_s=cloud.presence_end_s)
    return [egress, Acting(held), SetReport(report)]


def _us(age_s: float | None) -> int:
    """Return microseconds; -1 for never, also if the sender had heard nothing of us and the age has no bound."""
    return -1 if age_s is None or age_s == float("inf") else max(0, round(age_s * 1e6))
