"""What may leave the cloud: messages under a lease, which ends by the cloud's own clock.

A grant echoes a beat of the cloud. The lease ends at the send time of that beat plus the length of the lease, so a
grant that waited in a buffer is worth nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from robot_offload_core.fence.token import Token, presence


@dataclass(frozen=True)
class Lease:
    """State of the cloud's control. Times on its own steady clock, seconds.

    Attributes:
        cloud: incarnation of this control process.
        robot: incarnation of the robot served; "" for none.
        epoch: newest epoch that this robot has named.
        granted: that epoch came with a grant.
        in_charge: the grant is to be in charge, not only to get ready.
        end_s: end of the lease of that epoch.
        presence_end_s: until when nodes with placement Cloud may publish, whichever side is in charge.
        void_before_s: a grant that echoes a beat sent before this time is void.
    """

    cloud: str
    robot: str = ""
    epoch: int = 0
    granted: bool = False
    in_charge: bool = False
    end_s: float = 0.0
    presence_end_s: float = 0.0
    void_before_s: float = 0.0


@dataclass(frozen=True)
class Granted:
    """What a beat of the robot grants.

    Attributes:
        token: of the beat: the robot that sent it, its epoch, the cloud that it addresses.
        granted, in_charge, presence: see `grant.Permission`; presence is for nodes with placement Cloud.
        echo_s: send time of our beat that it echoes; None if it echoes none of ours.
        length_s: of the lease.
    """

    token: Token
    granted: bool
    in_charge: bool
    presence: bool
    echo_s: float | None
    length_s: float


@dataclass(frozen=True)
class Leave:
    """What may leave, and until when; the egress holds it and checks the clock for each message.

    Attributes:
        token: for outputs of duplicated nodes; None: none leaves.
        lease_end_s: end of `token`.
        in_charge: False while the cloud only gets ready: consumers there do not hear it yet.
        presence: token for outputs of nodes with placement Cloud; None: none leaves.
        presence_end_s: end of `presence`.
    """

    token: Token | None
    lease_end_s: float
    in_charge: bool = False
    presence: Token | None = None
    presence_end_s: float = 0.0


def start(cloud: str) -> Lease:
    """Return the state of a control process of the cloud that starts; `cloud` is its incarnation."""
    return Lease(cloud)


def holds(lease: Lease, now_s: float) -> bool:
    """Return whether a lease is held."""
    return lease.granted and now_s < lease.end_s


def serve(lease: Lease, robot: str, now_s: float) -> Lease:
    """Serve another incarnation of the robot ("" for none), but never while a lease is held."""
    if robot == lease.robot or holds(lease, now_s):
        return lease
    return Lease(lease.cloud, robot, void_before_s=lease.void_before_s)


def hear(lease: Lease, heard: Granted, now_s: float) -> Lease:
    """Take what a beat grants. A newer epoch ends the lease of the older one at once."""
    token = heard.token
    if token.robot != lease.robot or token.cloud != lease.cloud or token.epoch < lease.epoch:
        return lease
    if token.epoch > lease.epoch:
        lease = replace(lease, epoch=token.epoch, granted=False, in_charge=False, end_s=0.0)
    if heard.granted:
        lease = replace(lease, granted=True, in_charge=heard.in_charge)
    if heard.echo_s is None or not lease.void_before_s <= heard.echo_s <= now_s:
        return lease
    end_s = heard.echo_s + heard.length_s
    if heard.granted or heard.presence:
        lease = replace(lease, presence_end_s=max(lease.presence_end_s, end_s))
    return replace(lease, end_s=max(lease.end_s, end_s)) if heard.granted else lease


def void(lease: Lease, now_s: float) -> Lease:
    """End everything after a pause of this process or host, until a grant echoes a beat sent after the pause."""
    return replace(lease, end_s=0.0, presence_end_s=0.0, void_before_s=now_s)


def leave(lease: Lease, now_s: float) -> Leave:
    """Return what may leave now."""
    token, end_s, in_charge = None, 0.0, False
    if holds(lease, now_s):
        token, end_s, in_charge = Token(lease.robot, lease.epoch, lease.cloud), lease.end_s, lease.in_charge
    if now_s < lease.presence_end_s:
        return Leave(token, end_s, in_charge, presence(lease.robot, lease.cloud), lease.presence_end_s)
    return Leave(token, end_s, in_charge)


def leaves(held: Leave, now_s: float, *, of_cloud: bool = False) -> Token | None:
    """Return the token under which a message may leave now; None if it may not."""
    token, end_s = (held.presence, held.presence_end_s) if of_cloud else (held.token, held.lease_end_s)
    return token if now_s < end_s else None
