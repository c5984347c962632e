"""What the robot may grant: one side in charge, at most one that gets ready, each under its own epoch.

An epoch is used once. The end of a preparation or of a stay takes a new one, so that the gate never has to go back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token


@dataclass(frozen=True)
class Grant:
    """State of the robot's control.

    Attributes:
        robot: incarnation of this control process.
        site: the side in charge.
        epoch: of the side in charge.
        last_epoch: highest epoch used, including preparations.
        candidate: epoch of the side that gets ready; 0 for none.
        offered: the gate may have been given the candidate, and may change over at any moment.
        cloud: incarnation of the cloud that is in charge or gets ready.
        clear_s: from this time on every lease granted before has certainly ended.
    """

    robot: str
    clear_s: float
    site: Site = Site.ROBOT
    epoch: int = 1
    last_epoch: int = 1
    candidate: int = 0
    offered: bool = False
    cloud: str = ""


@dataclass(frozen=True)
class Permission:
    """What the robot allows the cloud.

    Attributes:
        token: under which the cloud may act.
        granted: the cloud may act, or get ready, under that token.
        in_charge: the cloud is in charge; False while it only gets ready.
    """

    token: Token
    granted: bool
    in_charge: bool


def start(robot: str, now_s: float, stopped_s: float) -> Grant:
    """Return the state of a control process that starts.

    Args:
        robot: its incarnation.
        now_s: when it started.
        stopped_s: time after which a cloud without permission has certainly stopped: how long the pulse may repeat a
            permission, plus a lease, plus the drift of two clocks over that time.
    """
    return Grant(robot, now_s + stopped_s)


def prepare(grant: Grant, cloud: str) -> Grant:
    """Begin to get the other side ready under a new epoch; `cloud` is the incarnation addressed."""
    if grant.candidate:
        return grant
    candidate = grant.last_epoch + 1
    addressed = cloud if grant.site is Site.ROBOT else grant.cloud
    return replace(grant, candidate=candidate, last_epoch=candidate, offered=False, cloud=addressed)


def offer(grant: Grant) -> Grant:
    """Let the gate change over to the side that gets ready."""
    return replace(grant, offered=True) if grant.candidate else grant


def take_over(grant: Grant, now_s: float, stopped_s: float) -> Grant:
    """Put the robot in charge under a new epoch: at a sudden loss, or when a preparation of the cloud is called off."""
    epoch = grant.last_epoch + 1
    return replace(
        grant, site=Site.ROBOT, epoch=epoch, last_epoch=epoch, candidate=0, offered=False, clear_s=now_s + stopped_s
    )


def call_off(grant: Grant, now_s: float, stopped_s: float) -> Grant:
    """End a preparation.

    The gate may be about to change over to the cloud; only a newer epoch prevents that. If the robot was getting ready,
    the cloud stays in charge and keeps its epoch.
    """
    if grant.site is Site.ROBOT:
        return take_over(grant, now_s, stopped_s) if grant.candidate else grant
    return replace(grant, candidate=0, offered=False)


def entered(grant: Grant, charge: Charge, now_s: float, stopped_s: float) -> Grant:
    """Follow the gate, which has changed over to a candidate, even to one that was called off meanwhile."""
    if charge.token.robot != grant.robot or not grant.epoch < charge.token.epoch <= grant.last_epoch:
        return grant
    grant = replace(grant, site=charge.site, epoch=charge.token.epoch, candidate=0, offered=False)
    return replace(grant, clear_s=now_s + stopped_s) if charge.site is Site.ROBOT else grant


def current(grant: Grant) -> Charge:
    """Return the charge of the side in charge."""
    return _charge(grant, grant.site, grant.epoch)


def preparing(grant: Grant) -> Charge | None:
    """Return the charge of the side that gets ready; None while none does."""
    return _charge(grant, grant.site.other, grant.candidate) if grant.candidate else None


def following(grant: Grant) -> Charge | None:
    """Return the charge that the gate may change over to; None while it may not."""
    return preparing(grant) if grant.offered else None


def permission(grant: Grant, heard: str) -> Permission:
    """Return what the cloud is allowed; without a grant `heard` is the incarnation addressed."""
    prepares = grant.site is Site.ROBOT and grant.candidate > 0
    in_charge = grant.site is Site.CLOUD
    granted = prepares or in_charge
    epoch = grant.candidate if prepares else grant.epoch
    return Permission(Token(grant.robot, epoch, grant.cloud if granted else heard), granted, in_charge)


def effects(grant: Grant, now_s: float) -> Site | None:
    """Return the side whose uncollected effects are admitted; None while the other side might still act."""
    if grant.site is Site.CLOUD:
        return Site.CLOUD
    return None if grant.offered or now_s < grant.clear_s else Site.ROBOT


def _charge(grant: Grant, site: Site, epoch: int) -> Charge:
    return Charge(site, Token(grant.robot, epoch, grant.cloud if site is Site.CLOUD else ""))
