"""Lets a node hand its state to its replica on the other side: bytes on `~/offload/state` and `~/offload/restore`.

A node that keeps something between its messages publishes it as bytes, whenever it changes and at most a few times a
second. Its replica, which is inactive, gets the newest bytes and takes them when it is activated:

    class Localiser(StatefulNode):
        def take_state(self, version, data):  # in on_activate, and later while it has taken or published none
            self.pose = struct.unpack("<3d", data)

        def on_scan(self, scan):
            ...
            self.publish_state(1, struct.pack("<3d", *self.pose))

What arrives is whole (checked by its header), but comes from the network: read it with `struct` or `json`, never with
`pickle`. Needs rclpy and std_msgs, and nothing of Robot Offload.
"""

from robot_offload_state.node import StatefulNode
from robot_offload_state.packing import FORMAT, SnapshotError, pack, unpack

__all__ = ["FORMAT", "SnapshotError", "StatefulNode", "pack", "unpack"]
