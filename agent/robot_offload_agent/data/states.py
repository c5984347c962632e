"""The state of nodes: what a node here publishes is read; what its replica published is published for it.

A snapshot: `~/offload/state` is read, `~/offload/restore` is published, latched. A topic: the node's own is read, the
private name of `restore` is published, to a node that listens. Parameters: `copies`.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_native
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from robot_offload_agent.data.copies import ParameterCopies
from robot_offload_agent.ros import raw
from robot_offload_agent.ros.managed_nodes import full_name
from robot_offload_agent.runtime.collector_memory import HolderView
from robot_offload_agent.settings.parameters import Configuration, Named
from robot_offload_agent.settings.served import private_name
from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.process import DataProcess
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.data.states import CloudStates, RobotStates, StateProcess
from robot_offload_core.words.declared import ParameterState, SnapshotState, StateSpec, TopicState
from robot_offload_core.words.holding import Holding

HEARD = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
KEPT = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
GIVEN = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
AT_ONCE = Duration(seconds=0)
AS_PUBLISHED = {"type": "auto", "reliability": "auto", "durability": "auto", "depth": 10}


def carried_states(configuration: Configuration) -> dict[str, StateSpec]:
    """Return the declared state by the names of its entries."""
    return {state.name: spec for state, spec in zip(configuration.states, configuration.state_specs(), strict=True)}


class StateTopics:
    """The topics of each state, and the core's exchange behind them."""

    def __init__(self, configuration: Configuration, node: Any, data: DataProcess) -> None:
        self.configuration, self.node = configuration, node
        self.view = HolderView(Path(configuration.runtime_dir))
        self.states = carried_states(configuration)
        self.process: StateProcess
        if isinstance(data, RobotDataProcess):
            self.process = RobotStates(self.states, self, data)
        else:
            assert isinstance(data, CloudDataProcess)
            self.process = CloudStates(self.states, self, data)
        self.side = configuration["side"]
        self.publishers: dict[str, Any] = {}
        self.heard: dict[str, raw.RawSubscription] = {}
        for name, state in self.states.items():
            if isinstance(state, TopicState):
                spec = Named(name, {**AS_PUBLISHED, "type": state.type})
                heard = partial(self.process.published, name)
                self.heard[name] = raw.RawSubscription(node, self._source(state), spec, False, heard)
            elif isinstance(state, SnapshotState):
                self._snapshot_topics(name, state)
        parameters = {name: state for name, state in self.states.items() if isinstance(state, ParameterState)}
        self.copies = ParameterCopies(configuration, parameters, self.process) if parameters else None

    def _snapshot_topics(self, name: str, state: SnapshotState) -> None:
        full = full_name(self.configuration, state.node)
        self.publishers[name] = self.node.create_publisher(UInt8MultiArray, f"{full}/offload/restore", KEPT)
        hear = raw.stamped(partial(self.process.published, name))
        self.node.create_subscription(UInt8MultiArray, f"{full}/offload/state", hear, HEARD, raw=True)

    def _source(self, state: TopicState) -> str:
        """Return the topic that the node here publishes: the private one if it is an output too."""
        outputs = self.configuration.outputs
        private = (str(o[f"{self.side}_topic"]) for o in outputs if o["topic"] == state.topic)
        return next(private, state.topic)

    def resolve(self) -> bool:
        """Subscribe to topics that have a publisher, make publishers whose type is known; return whether all are."""
        resolved = True
        for name, heard in self.heard.items():
            state = self.states[name]
            assert isinstance(state, TopicState)
            resolved = heard.resolve() and resolved
            type_name = heard.type_name or self._type_of_listener(private_name(self.side, state.restore))
            if type_name and name not in self.publishers:
                topic = private_name(self.side, state.restore)
                self.publishers[name] = raw.make_publisher(self.node, topic, type_name, GIVEN)
            resolved = resolved and name in self.publishers
        return resolved

    def _type_of_listener(self, topic: str) -> str:
        types = {info.topic_type for info in self.node.get_subscriptions_info_by_topic(topic)}
        return types.pop() if len(types) == 1 else ""

    def restore(self, name: str, payload: bytes) -> bool:
        """Publish a state for this side's node; a topic's only if there is a subscriber."""
        publisher = self.publishers.get(name)
        if publisher is None or (name in self.heard and not publisher.get_subscription_count()):
            return False
        publisher.publish(payload)
        return True

    def has(self, name: str) -> bool:
        """Return whether a reader has acknowledged the newest snapshot; True if the middleware cannot report that."""
        publisher = self.publishers[name]
        try:
            return bool(publisher.get_subscription_count()) and publisher.wait_for_all_acked(AT_ONCE)
        except rclpy_native.RCLError:
            return True

    def set_parameters(self, name: str, payload: bytes, active: bool) -> str | None:
        """Set parameters at this side's nodes; see StatePorts."""
        return self.copies.wish(name, payload, active) if self.copies is not None else None

    def holder(self) -> Holding:
        """Return the holder."""
        return self.view.look()
