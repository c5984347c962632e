"""The topics of state: `~/offload/state` of a node here is heard, `~/offload/restore` is published for it, latched."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from robot_offload_agent.process.collector_memory import HolderView
from robot_offload_agent.ros.managed_nodes import ros_name
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.declared import SnapshotState
from robot_offload_core.ledger.ports import Holding
from robot_offload_core.process.cloud_data import CloudDataProcess
from robot_offload_core.process.data import DataProcess
from robot_offload_core.process.robot_data import RobotDataProcess
from robot_offload_core.process.states import CloudStates, RobotStates, StateProcess

HEARD = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
KEPT = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def snapshot_states(configuration: Configuration) -> dict[str, SnapshotState]:
    """Returns the declared snapshots by the names of their entries."""
    named = zip(configuration.states, configuration.state_specs(), strict=True)
    return {state.name: spec for state, spec in named if isinstance(spec, SnapshotState)}


class StateTopics:
    """Both topics of each node with snapshots, and the core's exchange behind them."""

    def __init__(self, configuration: Configuration, node: Any, data: DataProcess) -> None:
        self.view = HolderView(Path(configuration.runtime_dir))
        states = snapshot_states(configuration)
        self.process: StateProcess
        if isinstance(data, RobotDataProcess):
            self.process = RobotStates(states, self, data)
        else:
            assert isinstance(data, CloudDataProcess)
            self.process = CloudStates(states, self, data)
        names = {spec.name: ros_name(configuration.side, spec) for spec in configuration.node_specs()}
        namespace = configuration["namespace"].rstrip("/")
        self.publishers: dict[str, Any] = {}
        for name, state in states.items():
            full = names[state.node] if names[state.node].startswith("/") else f"{namespace}/{names[state.node]}"
            self.publishers[name] = node.create_publisher(UInt8MultiArray, f"{full}/offload/restore", KEPT)
            node.create_subscription(
                UInt8MultiArray, f"{full}/offload/state", partial(self.process.published, name), HEARD, raw=True
            )

    def restore(self, name: str, payload: bytes) -> None:
        """Publishes a snapshot for this side's node."""
        self.publishers[name].publish(payload)

    def holder(self) -> Holding:
        """Returns who holds."""
        return self.view.look()
