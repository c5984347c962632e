"""A container with three nodes, run by its path: `walker`, a localizer with a lifecycle, a driver without one.

The localizer publishes map -> odom while it is Active; the driver base_link -> arm, the static arm -> gripper,
joint states and diagnostics all the time. Number and process are in what they publish, see `transform_buffer.py`.
"""

import contextlib
import os

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from nodes import Walker  # beside this file, which is run by its path
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

STATIC = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TF_HZ = 20.0
OTHER_HZ = 10.0


def transform(node: Node, parent: str, child: str, number: int) -> TFMessage:
    """Returns a message with one transform, stamped now; its x is `number`, its y the process."""
    made = TransformStamped()
    made.header.stamp = node.get_clock().now().to_msg()
    made.header.frame_id, made.child_frame_id = parent, child
    made.transform.translation.x, made.transform.translation.y = float(number), float(os.getpid())
    made.transform.rotation.w = 1.0
    return TFMessage(transforms=[made])


class Localizer(LifecycleNode):
    """Publishes map -> odom while it is Active."""

    def __init__(self, name: str, private: str) -> None:
        super().__init__(name, enable_rosout=False)
        self.number = 0
        self.transforms = self.create_lifecycle_publisher(TFMessage, f"{private}/tf", 100)
        self.create_timer(1 / TF_HZ, self.tell)

    def tell(self) -> None:
        if self.transforms.is_activated:
            self.number += 1
            self.transforms.publish(transform(self, "map", "odom", self.number))


class Driver(Node):
    """Publishes all the time, on both sides."""

    def __init__(self, name: str, private: str) -> None:
        super().__init__(name, enable_rosout=False)
        self.number = 0
        self.producer = f"{name}.{os.getpid()}"
        self.transforms = self.create_publisher(TFMessage, f"{private}/tf", 100)
        self.joints = self.create_publisher(JointState, f"{private}/joint_states", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, f"{private}/diagnostics", 10)
        self.static = self.create_publisher(TFMessage, f"{private}/tf_static", STATIC)
        self.static.publish(transform(self, "arm", "gripper", 1))
        self.create_timer(1 / TF_HZ, self.move)
        self.create_timer(1 / OTHER_HZ, self.tell)

    def move(self) -> None:
        self.number += 1
        self.transforms.publish(transform(self, "base_link", "arm", self.number))

    def tell(self) -> None:
        said = f"{self.producer}#{self.number}"
        self.joints.publish(JointState(name=[said], position=[0.1]))
        self.diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name=f"driver: {said}")]))


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    walker = Walker()
    prefix, side = ("remote_", "cloud") if walker.get_name().startswith("remote_") else ("", "robot")
    nodes = [walker, Localizer(f"{prefix}localizer", f"/offload/{side}"), Driver(f"{prefix}driver", f"/offload/{side}")]
    for node in nodes:
        executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
