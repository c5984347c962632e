"""State in virtual time: nodes that publish snapshots, the core's exchange, and the observer of invariant 8."""

from __future__ import annotations

import struct
import zlib

from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.process import DataProcess
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.data.states import CloudStates, RobotStates, StateProcess
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.topics import snapshots
from robot_offload_core.words.declared import StateSpec
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.lifecycle import State
from robot_offload_sim.sides.cloud_side import CloudSide
from robot_offload_sim.sides.robot_side import RobotSide
from robot_offload_sim.world.scenario import Scenario
from robot_offload_sim.world.since import Since
from robot_offload_sim.world.violations import ViolationError
from robot_offload_sim.world.world import World

SAID = struct.Struct(">Bd")
"""The maker of a snapshot (1: the robot's node), and its true time."""
TORN_BYTE = 35
"""Byte within the time in a serialized snapshot: after 16 bytes of CDR, 18 of the header, 1 of the maker."""
SLACK_S = 0.005
"""Difference between true time and the hosts' clocks over the oldest age that is judged."""


class Kept:
    """One side's node with state, and the shell of its side's exchange.

    Attributes:
        restored_s: true time at which the newest snapshot was made that this node was given by the present data
            process: one that has just begun knows of none, and says of what comes next how old it is.
        silent: active faults that keep the node from publishing.
        torn: share of arrivals whose bytes are damaged.
        deaf: active faults that keep the node from reading what it is given.
        took: how many snapshots the node was given.
        since, excused_s: the part of a snapshot's age that could not be known here, by the time at which it was made.
        began: for each activation of the node: when (true time), and whether it had got a snapshot by then.
    """

    def __init__(
        self, world: World, site: Site, states: dict[str, StateSpec], side: RobotSide | CloudSide, robot: RobotSide,
        name: str, excused_s: dict[float, float],
    ) -> None:  # fmt: skip
        self.world, self.site, self.states, self.side, self.robot, self.name = world, site, states, side, robot, name
        self.excused_s = excused_s
        self.since = Since()
        self.node = side.nodes[self.states[name].node]
        self.process: StateProcess | None = None
        self.restored_s = float("-inf")
        self.silent = 0
        self.torn = 0.0
        self.deaf = 0
        self.took = 0
        self.began: list[tuple[float, bool]] = []
        self.node.woken = self.woke
        side.data.exchange = self.make
        side.data.damage = self.damage

    def make(self, data: DataProcess) -> StateProcess:
        """Return the exchange of a data process that has just begun."""
        self.restored_s = float("-inf")
        self.since = Since()
        if isinstance(data, RobotDataProcess):
            self.process = RobotStates(self.states, self, data)
        else:
            assert isinstance(data, CloudDataProcess)
            self.process = CloudStates(self.states, self, data)
        return self.process

    def say(self, period_s: float) -> None:
        """Publish repeatedly while the node is Active."""
        self.world.after(period_s, self.say, period_s)
        if self.node.state is State.ACTIVE and self.node.running and not self.silent and self.process is not None:
            data = SAID.pack(self.site is Site.ROBOT, self.world.now)
            self.side.data.post("state", self.hear, data, self.world.now, self.side.host.system_s())

    def hear(self, data: bytes, made_s: float, published_s: float) -> None:
        """Give the data process what the node published, with its publisher's stamp."""
        if self.process is not None:
            self.excused_s[made_s] = self.since.counts_s(self.side.host, made_s) - made_s
            self.process.published(self.name, serialized(data), published_s)

    def woke(self) -> None:
        """Take what the node was given; note whether it begins clean."""
        self.began.append((self.world.now, self.took > 0 and not self.deaf))

    def damage(self, payload: bytes) -> bytes:
        """Return a snapshot as it arrives, sometimes torn."""
        if self.world.dice.random() >= self.torn:
            return payload
        return payload[:TORN_BYTE] + b"?" + payload[TORN_BYTE + 1 :]

    def restore(self, name: str, payload: bytes) -> bool:
        """Give a snapshot to the node; judge what it gets."""
        found = snapshots.parse(payload, 1024)
        self.expect(isinstance(found, snapshots.Snapshot), "a torn snapshot is restored")
        assert isinstance(found, snapshots.Snapshot)
        assert self.process is not None
        self.expect(self.process.holding() is None, "a snapshot is restored at the side that holds")
        of_robot, made_s = SAID.unpack(found.data)
        self.expect(bool(of_robot) is not (self.site is Site.ROBOT), "a node gets its own snapshot back")
        self.expect(made_s >= self.restored_s, "an older snapshot is restored")
        stood_s = self.side.host.stood_since(made_s)  # by a clock that stands still no message ages
        bound_s, true_s = self.process.standing[name].age_s + stood_s, self.world.now - made_s - self.excused_s[made_s]
        self.expect(bound_s >= true_s - SLACK_S, f"a snapshot of {true_s:.3f} s is said to be {bound_s:.3f} s old")
        self.restored_s = made_s
        self.took += 1
        return True

    def has(self, _name: str) -> bool:
        """Return whether the node reads what it is given."""
        return not self.deaf

    def set_parameters(self, name: str, payload: bytes, active: bool) -> str | None:
        """Refuse: the nodes here have no state other than snapshots."""
        raise AssertionError(name)

    def expect(self, holds: bool, text: str) -> None:
        """Raise ViolationError unless invariant 8 holds."""
        if not holds:
            raise ViolationError("8", f"{self.site.value}: {text}", self.world.now)

    def holder(self) -> Holding:
        """Read the collector's memory."""
        kept = self.robot.collector.kept
        if kept is None:
            return Holding(Site.ROBOT, 0, Token("", 0, ""))
        charge, _, fell_back, stay = kept
        return Holding(Site.ROBOT if fell_back else charge.site, stay, charge.token)


class Keeping:
    """The nodes with state of both sides: one state, by its name.

    Attributes:
        sides: the node of each side.
    """

    def __init__(self, world: World, scenario: Scenario, robot: RobotSide, cloud: CloudSide) -> None:
        (name,) = scenario.states
        excused_s: dict[float, float] = {}
        self.period_s = scenario.state_period_s
        self.sides = {
            site: Kept(world, site, scenario.states, side, robot, name, excused_s)
            for site, side in ((Site.ROBOT, robot), (Site.CLOUD, cloud))
        }

    def start(self) -> None:
        """Let the nodes publish."""
        for kept in self.sides.values():
            kept.say(self.period_s)


def serialized(data: bytes) -> bytes:
    """Return a snapshot as the middleware serializes its message."""
    head = snapshots.HEADER.pack(snapshots.MAGIC, snapshots.FORMAT, 1, len(data), zlib.crc32(data))
    packed = head + data
    cdr = b"\x00\x01\x00\x00" + struct.pack("<3I", 0, 0, len(packed)) + packed
    return cdr + bytes(-len(cdr) % 4)
