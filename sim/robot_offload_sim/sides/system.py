"""The whole world of a stretch or a story: both sides, the link between them, the driver and the sensors."""

from __future__ import annotations

from typing import Any

from robot_offload_core.words.messages import Carried
from robot_offload_sim.sides.cloud_side import CloudSide
from robot_offload_sim.sides.handing import Handing
from robot_offload_sim.sides.keeping import Keeping
from robot_offload_sim.sides.robot_side import RobotSide
from robot_offload_sim.world.coverage import Coverage
from robot_offload_sim.world.driver import Driver
from robot_offload_sim.world.link_model import Link
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload, Sensed, Surroundings
from robot_offload_sim.world.scenario import Scenario
from robot_offload_sim.world.world import Host, World


def size_of(words: tuple[Any, ...]) -> int:
    """Return the bytes of a datagram: those of its message, and 200 for the rest."""
    for word in words:
        payload = word.payload if isinstance(word, Carried) else word
        message = payload.message if isinstance(payload, Payload) else payload
        if isinstance(message, Message):
            return message.size + 200
    return 200


class System:
    """Everything wired together, at rest.

    Attributes:
        handing: relays, servers and clients, if services or actions are declared.
        keeping: nodes with state, if it is declared.
        silent_inputs: indices of inputs that faults keep silent, once per fault.
        rivals: nodes that publish the topic of output 0 besides the collector.
        cut_short_s: true time when pods last ended before the robot had taken over, which they had requested.
    """

    def __init__(self, scenario: Scenario, name: str) -> None:
        self.scenario = scenario
        self.world = World(name)
        self.world.inbox_limit = scenario.inbox
        self.world.size_of = size_of
        self.coverage = Coverage()
        self.link = Link(self.world, base_s=scenario.delay_s, jitter_s=scenario.jitter_s, drops=scenario.drops)
        robot_host, cloud_host = Host(self.world, "robot"), Host(self.world, "cloud")
        self.driver = Driver(self.world, robot_host)
        self.around = Surroundings(self.world, scenario, self.coverage, self.link, self.driver)
        self.robot = RobotSide(self.around, robot_host)
        self.cloud = CloudSide(self.around, cloud_host)
        plan = scenario.relay
        self.handing = Handing(self.around, self.robot, self.cloud, plan) if plan is not None else None
        self.keeping = Keeping(self.world, scenario, self.robot, self.cloud) if scenario.states else None
        self.silent_inputs: list[int] = []
        self.rivals = self.robot.collector.rivals
        self.inputs_sent = 0
        self.cut_short_s = float("-inf")

    def start(self) -> None:
        """Start both sides, the driver and the sensors."""
        self.driver.start()
        self.robot.start()
        self.cloud.start()
        if self.handing is not None:
            self.handing.start()
        if self.keeping is not None:
            self.keeping.start()
        for index in range(len(self.scenario.inputs)):
            self._sense(index)

    def _sense(self, index: int) -> None:
        spec = self.scenario.inputs[index]
        if index not in self.silent_inputs:
            self.inputs_sent += 1
            payload = Sensed(self.inputs_sent.to_bytes(8, "big") if spec.latched else b"scan")
            payload.since_s = self.world.now
            self.robot.data.post("sensors", self.robot.data.input, spec.name, payload, self.robot.host.system_s())
        self.world.after(self.scenario.input_periods_s[index], self._sense, index)
