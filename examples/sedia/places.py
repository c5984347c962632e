"""From messages to places and back."""

import math

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TransformStamped
from place import Place  # type: ignore[import-not-found]  # of the wheelchair


def place(pose: object) -> Place:
    """Return the place in a geometry_msgs/Pose."""
    at, turned = pose.position, pose.orientation  # type: ignore[attr-defined]  # ROS messages have no types
    return Place(at.x, at.y, 2.0 * math.atan2(turned.z, turned.w))


def moved(transform: object) -> Place:
    """Return the place in a geometry_msgs/Transform."""
    at, turned = transform.translation, transform.rotation  # type: ignore[attr-defined]  # ROS messages have no types
    return Place(at.x, at.y, 2.0 * math.atan2(turned.z, turned.w))


def posed(where: Place, stamp: Time, frame: str = "map") -> PoseStamped:
    """Return a place as a message."""
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = stamp, frame
    message.pose.position.x, message.pose.position.y = float(where.x_m), float(where.y_m)
    message.pose.orientation.z, message.pose.orientation.w = math.sin(where.yaw_rad / 2), math.cos(where.yaw_rad / 2)
    return message


def transform(parent: str, child: str, where: Place) -> TransformStamped:
    """Return where the frame `child` is, seen from `parent`."""
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.transform.translation.x, made.transform.translation.y = float(where.x_m), float(where.y_m)
    made.transform.rotation.z, made.transform.rotation.w = math.sin(where.yaw_rad / 2), math.cos(where.yaw_rad / 2)
    return made
