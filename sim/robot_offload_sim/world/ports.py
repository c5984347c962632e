"""What a side of the simulated world may see and do: its surroundings, and the witness of its actions.

The sides do not know faults, the observer or each other: what they send goes into a wire or to a process of the same
host, and what they do is shown to a `Witness`. Faults and the observer are above them and see everything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, Protocol

from robot_offload_core.control.process import ControlProcess
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.control.robot.placement import Robot
from robot_offload_core.fence.envelope import decode
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.beats import Beat, Permission
from robot_offload_core.words.decided import Decided
from robot_offload_core.words.gates import Gate
from robot_offload_sim.world.coverage import Coverage
from robot_offload_sim.world.driver import Driver
from robot_offload_sim.world.link_model import Link
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.scenario import Scenario
from robot_offload_sim.world.world import World

decoded = lru_cache(maxsize=512)(decode)
"""Decodes a header, with a cache: egress, collector and observer read the same few."""


class Sensed(bytes):
    """A message of an input.

    Attributes:
        since_s: true time from which its age counts: when it was published, or as in `Since` if unknown to the robot.
    """

    since_s: float = 0.0


class Payload(NamedTuple):
    """A stand-in for the bytes of an output's message.

    Attributes:
        site: side of the replica.
        message: the message that it published.
        header: header of the envelope under which it left the cloud; b"" for the robot's.
        left_s: true time from which its age counts: when it left its replica, or as in `Since` if unknown to the cloud.
    """

    site: Site
    message: Message
    header: bytes
    left_s: float

    def __radd__(self, before: bytes) -> bytes:
        """Stand in for its bytes where a latched one is hashed."""
        return before + repr(self.message).encode()


class Witness(Protocol):
    """Receives what the sides do; the observer documents how each call is judged."""

    def robot_started(self, incarnation: str) -> None:
        """Note that the robot's control process has started."""

    def cloud_started(self, incarnation: str) -> None:
        """Note that the cloud's control process has started."""

    def gate_said(self, gate: Gate) -> None:
        """Note that the robot's control has sent a gate to the collector."""

    def robot_decided(self, decided: Decided) -> None:
        """Note that the robot's control has reported a decision."""

    def control_ticked(self) -> None:
        """Note that the robot's control has taken a turn."""

    def robot_effect(self, robot: Robot) -> None:
        """Note that the robot admits an effect of its own."""

    def cloud_effect(self, token: Token) -> None:
        """Note that the collector has admitted an effect of the cloud."""

    def permitted(self, permission: Permission, robot: str) -> None:
        """Note that the robot's control renews a permission."""

    def beat_sent(self, beat: Beat) -> None:
        """Note that the robot's pulse sends a beat."""

    def cloud_beat(self, beat: Beat, arrived_s: float) -> None:
        """Note that a newer beat of a cloud reached the robot's pulse."""

    def grant_delivered(self, beat: Beat, sent_true_s: float) -> None:
        """Note that the cloud's control gets a robot's beat that was sent at a true time."""

    def left_cloud(self, token: Token) -> None:
        """Note that a message or an effect leaves the cloud."""

    def passed(self, index: int, payload: Payload) -> None:
        """Note that a message reached the robot's consumer of an output."""

    def flipped(self, left: Charge | None) -> None:
        """Note that the collector has changed over between two messages, away from `left`."""

    def heard_in_cloud(self, index: int, payload: Payload) -> None:
        """Note that a message reached the consumer of an output in the cloud."""

    def filled(self, side: Site, index: int, payload: Payload) -> None:
        """Note that a replica of a shared output got on its private topic what it would receive on the public one."""

    def input_heard(self, name: str, age_s: float) -> None:
        """Note that a message of an input reached the cloud's replicas; `age_s` since its publication (true time)."""

    def available(self, statements: tuple[Available, ...]) -> None:
        """Note that the robot's control states which nodes with placement Cloud have results that arrive."""

    def answered(self, key: int, accepted: bool, message: str) -> None:
        """Note that a switch by hand was answered."""


@dataclass
class Surroundings:
    """The world around a side.

    Attributes:
        entered: called with the name of a state that a machine has entered ("robot ToCloud").
        controlled: called with each control process that starts.
        witness: set before anything starts.
    """

    world: World
    scenario: Scenario
    coverage: Coverage
    link: Link
    driver: Driver
    entered: Callable[[str], None] = field(default=lambda _state: None)
    controlled: Callable[[ControlProcess], None] = field(default=lambda _process: None)
    witness: Witness = field(init=False)
