"""The robot's grants and the cloud's lease: what leaves the cloud, and how long after it was last permitted.

The gate is whatever it likes to be: it may report any change at any moment.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace

from robot_offload_core.fence import grant, lease
from robot_offload_core.fence.grant import Permission
from robot_offload_core.fence.lease import Granted, Lease, Leave
from robot_offload_core.fence.token import Site, Token
from tests.simulation.fence.bounds import NOW, Bounds
from tests.simulation.fence.explore import BrokenError
from tests.simulation.fence.robot import Robot, RobotPart


@dataclass(frozen=True)
class Cloud:
    """The lease, and all that the egress may still believe to have; it does not die with the cloud's control."""

    number: int
    lease: Lease
    egress: frozenset[Leave]


@dataclass(frozen=True)
class Claims:
    """What must hold of the cloud: which tokens may be used, and whether the robot's own effects are admitted."""

    permitted: frozenset[Token]
    robot_acts: bool


class CloudWorld:
    """See the module."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
        self.part = RobotPart(bounds, self._speech)

    def _speech(self, robot: Robot) -> dict[Hashable, int]:
        permissions = [grant.permission(robot.grant, f"cloud{number}") for number in range(self.bounds.clouds)]
        return {said: self.bounds.stopped if said.granted else -1 for said in permissions}

    def start(self) -> tuple[Robot, Cloud]:
        """Return the first state: the cloud was never granted anything."""
        return self.part.start(), Cloud(0, Lease("cloud0"), frozenset())

    def robot_moves(self, robot: Robot) -> Iterator[tuple[str, Robot]]:
        """Yield what control may do, and what it makes of any report of a gate."""
        yield from self.part.moves(robot)
        yield from self.part.any_report(robot)

    def robot_tick(self, robot: Robot) -> Robot:
        """Return the robot one tick later."""
        return self.part.tick(robot)

    def tells(self, cloud: Cloud) -> Hashable:
        """Return what control hears of the cloud: nothing that its grant depends on."""
        del cloud
        return None

    def told(self, robot: Robot, said: Hashable) -> Iterator[tuple[str, Robot]]:
        """Yield nothing: see `tells`."""
        del robot, said
        return iter(())

    def inputs(self, robot: Robot) -> list[Hashable]:
        """Return what may reach the cloud now: another robot to serve, and each grant under way with its age."""
        return [*range(robot.number + 1), *self.part.under_way(robot).items()]

    def react(self, cloud: Cloud, heard: Hashable) -> Iterator[tuple[str, Cloud]]:
        """Yield the cloud after what has reached it; a grant may carry any echo that is not younger than it."""
        if isinstance(heard, int):
            served = lease.serve(cloud.lease, f"robot{heard}", NOW)
            if lease.holds(cloud.lease, NOW) and served.robot != cloud.lease.robot:
                raise BrokenError("another robot is served while a lease is held")
            yield f"cloud serves robot{heard}", self._leased(cloud, served)
            return
        assert isinstance(heard, tuple)
        said, age = heard
        assert isinstance(said, Permission)
        for echo in range(max(0, age - self.bounds.vouch), self.bounds.lease + 1):
            got = Granted(said.token, said.granted, said.in_charge, False, NOW - echo, self.bounds.lease)
            after = lease.hear(cloud.lease, got, NOW)
            if lease.holds(cloud.lease, NOW) and after.robot != cloud.lease.robot:
                raise BrokenError("another robot is served while a lease is held")
            name = f"cloud hears {said.token.robot[-1]}.{said.token.epoch}, {age} old, with an echo {echo} old"
            yield name, self._leased(cloud, after)

    def moves(self, cloud: Cloud) -> Iterator[tuple[str, Cloud]]:
        """Yield what happens to the cloud's control by itself."""
        if cloud.number + 1 < self.bounds.clouds:
            number = cloud.number + 1
            yield "cloud restarts", replace(cloud, number=number, lease=Lease(f"cloud{number}"))
        if lease.holds(cloud.lease, NOW):
            yield "cloud stood still", self._leased(cloud, lease.void(cloud.lease, NOW))

    def tick(self, cloud: Cloud) -> Cloud:
        """Return the cloud one tick later; the egress forgets what has ended a tick after that."""
        leased = cloud.lease
        end_s = max(leased.end_s - 1, NOW) if leased.end_s else 0.0
        void_s = leased.void_before_s - 1 if leased.void_before_s > NOW - self.bounds.lease else 0.0
        leased = replace(leased, end_s=end_s, void_before_s=void_s)
        egress = frozenset(
            replace(held, lease_end_s=held.lease_end_s - 1) for held in cloud.egress if held.lease_end_s > NOW - 1
        )
        return Cloud(cloud.number, leased, egress)

    def _leased(self, cloud: Cloud, after: Lease) -> Cloud:
        """Return the cloud with another lease, of which the egress may know from now on until it ends."""
        after = replace(after, end_s=max(after.end_s, NOW) if after.end_s else 0.0)
        held = lease.leave(after, NOW)
        egress = cloud.egress
        if held.token is not None and not any(_covers(known, held) for known in egress):
            egress = frozenset(known for known in egress if not _covers(held, known)) | {held}
        return Cloud(cloud.number, after, egress)

    def claims(self, robot: Robot) -> Claims:
        """Return what must hold of the cloud while the robot is in this state."""
        permitted = {
            said.token for said, age in self.part.under_way(robot).items()
            if isinstance(said, Permission) and said.granted and age < self.bounds.stopped
        }  # fmt: skip
        return Claims(frozenset(permitted), grant.effects(robot.grant, NOW) is Site.ROBOT)

    def check(self, claims: Claims, cloud: Cloud) -> None:
        """Raise BrokenError where the cloud may do what it must not."""
        for held in cloud.egress:
            token = lease.leaves(held, NOW)
            if token is None:
                continue
            if token not in claims.permitted:
                raise BrokenError(f"messages leave under epoch {token.epoch}, which was not permitted for a lease")
            if held.in_charge and claims.robot_acts:
                raise BrokenError("effects of the robot are admitted while the cloud may hold a lease to be in charge")


def _covers(one: Leave, other: Leave) -> bool:
    """Return whether whoever believes in one may do all that the other allows."""
    return one.token == other.token and one.lease_end_s >= other.lease_end_s and one.in_charge >= other.in_charge
