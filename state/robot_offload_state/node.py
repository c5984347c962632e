"""A lifecycle node whose state is handed to its replica."""

from __future__ import annotations

from array import array
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from robot_offload_state.packing import SnapshotError, pack, unpack

STATE = "~/offload/state"
RESTORE = "~/offload/restore"
_SAID = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
_KEPT = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class StatefulNode(LifecycleNode):
    """Base of lifecycle nodes with state; `super().on_activate` and `super().on_deactivate` have to be called.

    A node that began clean and has published its own state still takes the first snapshot that arrives: its replica
    acts and had not published before. Once it has taken a snapshot, its own state is the newer one.

    Attributes:
        restored: the newest snapshot that has arrived and was not taken yet.
    """

    def __init__(self, node_name: str, **options: Any) -> None:
        super().__init__(node_name, **options)
        self.restored: tuple[int, bytes] | None = None
        self._acting = self._said = self._taken = False
        self._state = self.create_publisher(UInt8MultiArray, STATE, _SAID)
        self._restore = self.create_subscription(UInt8MultiArray, RESTORE, self._arrived, _KEPT)

    def take_state(self, version: int, data: bytes) -> None:
        """Take the state of the replica on the other side; to be overridden.

        Args:
            version: what that replica gave to `publish_state`.
            data: its bytes; raise ValueError if they cannot be used: the node then starts clean and logs that.
        """
        raise NotImplementedError

    def publish_state(self, version: int, data: bytes) -> None:
        """Publish the state that a replica needs; do nothing while the node is not Active."""
        if self._acting:
            self._said = True
            self._state.publish(UInt8MultiArray(data=array("B", pack(version, data))))

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the newest snapshot, if there is one."""
        self._acting, self._said, self._taken = True, False, False
        self._take()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop publishing state."""
        self._acting = False
        return super().on_deactivate(state)

    def _arrived(self, message: UInt8MultiArray) -> None:
        try:
            self.restored = unpack(bytes(message.data))
        except SnapshotError as error:
            self.get_logger().warning(f"A snapshot was not taken: {error}")
            return
        if self._acting and not (self._said and self._taken):
            self._take()

    def _take(self) -> None:
        if self.restored is None:
            return
        (version, data), self.restored = self.restored, None
        self._taken = True
        try:
            self.take_state(version, data)
        except ValueError as error:
            self.get_logger().warning(f"Starting clean, a snapshot of version {version} cannot be used: {error}")
