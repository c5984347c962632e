"""The content of a recording: topics of the agent itself, what passes on the outputs, and what becomes of goals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.node import Node

from robot_offload_agent.record.mcap import results
from robot_offload_agent.ros import context
from robot_offload_agent.ros.live import ACTING, NOTES, PASSING, REASON, ROUND_TRIP
from robot_offload_agent.ros.raw import RawSubscription
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.settings.parameters import Configuration, Named

PLACEMENT = "/offload/placement"
HEARD = "/connectivity_test_remote"
DEPTH = 10
"""Of each subscription: large messages wait in the middleware's memory until this process reads them."""


@dataclass(frozen=True)
class Topic:
    """A topic to record; a type or QoS of `auto` is taken from the publishers."""

    name: str
    type_name: str = "auto"
    reliability: str = "auto"
    durability: str = "auto"

    @property
    def spec(self) -> Named:
        """In the form of a topic's parameters."""
        values = {"type": self.type_name, "reliability": self.reliability, "durability": self.durability}
        return Named(self.name, {**values, "depth": DEPTH})


def topics(configuration: Configuration) -> Iterator[Topic]:
    """Yield the topics of the robot's side."""
    latched, volatile = ("reliable", "transient_local"), ("best_effort", "volatile")
    yield Topic(PLACEMENT, "std_msgs/msg/String", *latched)
    yield Topic(ACTING, "std_msgs/msg/Int32", *latched)
    yield Topic(PASSING, "std_msgs/msg/Int32", *latched)
    yield Topic(REASON, "std_msgs/msg/String", *latched)
    yield Topic(NOTES, "rcl_interfaces/msg/Log", *latched)
    yield Topic("/network_status", "std_msgs/msg/Int32", *latched)
    yield Topic(ROUND_TRIP, "std_msgs/msg/Float64", *volatile)
    yield Topic(HEARD, "std_msgs/msg/Header", *volatile)
    yield Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", *volatile)
    for output in configuration.outputs:
        yield Topic(output["topic"])
    for action in (*configuration.actions, *configuration.used_actions):
        yield Topic(f"{action['name']}/_action/status", "action_msgs/msg/GoalStatusArray", *latched)
        yield Topic(f"{action['name']}/_action/feedback", f"{action['type']}_FeedbackMessage", "reliable", "volatile")


class Heard:
    """Subscriptions of `node` to what a recording has, and the results of goals.

    Args:
        node: spun by `topic_loop.spin_topics`.
        configuration: of the robot's agent.
        take: called with the topic's name, its type, whether it is latched, and each message.
    """

    def __init__(self, node: Node, configuration: Configuration, take: Callable[[str, str, bool, bytes], None]) -> None:
        self._take = take
        self._guard = Guard(context.is_up)
        self._results = results.of(node, configuration.actions, take)
        self._subscriptions: dict[str, RawSubscription] = {}
        for topic in topics(configuration):
            if topic.name not in self._subscriptions:
                self._subscriptions[topic.name] = RawSubscription(
                    node, topic.name, topic.spec, False, partial(self._heard, topic.name)
                )

    def resolve(self) -> None:
        """Subscribe to what has become known, and take results that have arrived; call this repeatedly."""
        for subscription in self._subscriptions.values():
            subscription.resolve()
        for asking in self._results.values():
            with self._guard:
                asking.look()

    def _heard(self, name: str, payload: Any) -> None:
        subscription = self._subscriptions[name]
        latched = subscription.qos is not None and subscription.qos.durability.name == "TRANSIENT_LOCAL"
        self._take(name, subscription.type_name, latched, bytes(payload))
        if name in self._results:
            with self._guard:
                self._results[name].heard(bytes(payload))
