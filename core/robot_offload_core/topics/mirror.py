"""Which side the consumers in the cloud hear: one at a time, in the order of the stays in charge.

They get messages of the cloud's own replicas while the cloud is in charge, not while it only gets ready. Messages that
passed at the robot's collector come back to them as a mirror. No message passes after one of a newer stay.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Site, Token


@dataclass(frozen=True)
class Mirror:
    """State of the gate in front of the consumers in the cloud.

    Attributes:
        robot: incarnation of the robot whose epochs count; "" for none yet.
        epoch: of the newest stay that the consumers have heard.
        site: the side that was in charge in that stay.
    """

    robot: str = ""
    epoch: int = 0
    site: Site | None = None


def own(mirror: Mirror, token: Token, *, in_charge: bool) -> tuple[Mirror, bool]:
    """Return whether a message of a replica here, sent under `token`, goes to the consumers here.

    Args:
        mirror: state of the gate.
        token: token under which the message leaves.
        in_charge: the robot has put the cloud in charge under this token; False while the cloud only gets ready.
    """
    return _pass(mirror, token, Site.CLOUD) if in_charge else (mirror, False)


def mirrored(mirror: Mirror, token: Token) -> tuple[Mirror, bool]:
    """Return whether a message that has passed at the robot under `token` goes to the consumers here."""
    return _pass(mirror, token, Site.ROBOT)


def _pass(mirror: Mirror, token: Token, site: Site) -> tuple[Mirror, bool]:
    same = mirror.robot == token.robot
    if same and (token.epoch < mirror.epoch or (token.epoch == mirror.epoch and mirror.site is not site)):
        return mirror, False
    return Mirror(token.robot, token.epoch, site), True
