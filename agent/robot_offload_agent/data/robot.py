"""The shell of the robot's data process: the topics of the inputs."""

from __future__ import annotations

from functools import partial

from robot_offload_agent.data.process import DataShell, plan, start
from robot_offload_agent.ros import raw
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.settings import offer, store
from robot_offload_agent.settings.parameters import Configuration, Named
from robot_offload_core.data.robot import RobotDataProcess


class RobotDataShell(DataShell):
    """The robot's data process in its shell."""

    process: RobotDataProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        rates_hz = {name: rate_hz for name, _, rate_hz in offer.input_limits(store.in_force(configuration))}
        self.process = RobotDataProcess(plan(configuration, rates_hz), self)
        self.inputs = [
            raw.RawSubscription(self.node, i["topic"], i, i["latched"], raw.stamped(partial(self.forward, i)))
            for i in (configuration.inputs if self.carried else ())
        ]

    def resolve(self) -> bool:
        """Subscribe to inputs that now have a publisher; return whether nothing is left to do."""
        resolved = [subscription.resolve() for subscription in self.inputs]
        for subscription in self.inputs:
            self.process.note(f"input {subscription.spec.name}", subscription.problem)
        return all(resolved)

    def forward(self, spec: Named, payload: bytes, published_s: float | None) -> None:
        """Take an input's message, on the ROS thread."""
        self.look_who_is_heard()
        publishers = self.node.count_publishers(spec["topic"]) if spec["latched"] else 1
        self.process.forward(spec.name, payload, publishers, published_s)

    def on_room(self, channel: str) -> None:
        """Send the waiting messages of an input."""
        kind, _, name = channel.partition("/")
        if kind == "in":
            with self.guard:
                self.process.room(name)

    def types(self) -> dict[str, str]:
        """Return the types of the inputs that have been found in the graph."""
        return {s.spec.name: raw.named_type(s.type_name, s.type_hash) for s in self.inputs if s.type_name}


def run(configuration: Configuration) -> None:
    """Run the process."""
    start(configuration, RobotDataShell)
