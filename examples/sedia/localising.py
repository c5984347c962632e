"""Where the robot is, and the map that it is on."""

import json
import math
from collections import deque

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from localiser import STATE  # type: ignore[import-not-found]  # of the wheelchair
from nav_msgs.msg import OccupancyGrid, Odometry
from places import Place, place, posed, transform  # type: ignore[import-not-found]  # beside this script, as all that follow
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rooms import CELL_M, WIDTH_M, grid  # type: ignore[import-not-found]
from serving import LATCHED, NEWEST, Managed  # type: ignore[import-not-found]
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from robot_offload_state import StatefulNode

VERSION = 1


class MapServer(Managed):
    """Publishes `map` once, for all who come."""

    def __init__(self) -> None:
        super().__init__("map_server")
        self._map = self.create_publisher(OccupancyGrid, "map", LATCHED)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the map."""
        cells = grid()
        message = OccupancyGrid(data=cells.ravel().tolist())
        message.header.frame_id = "map"
        message.info.resolution = CELL_M
        message.info.height, message.info.width = cells.shape
        message.info.origin.position.y = -WIDTH_M / 2
        self._map.publish(message)
        return super().on_activate(state)


class Amcl(StatefulNode):
    """Corrects odometry at each mark that it passes. What it knows of the drift is its state: it survives a change.

    Publishes `pose` for its own side, `amcl_pose` and the transform map -> odom for everybody, and `amcl/account`: how
    old the state was with which it began.
    """

    def __init__(self) -> None:
        super().__init__("amcl", start_parameter_services=False)
        self._wall = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._correction = Place()
        self._restored_age_s: float | None = None
        self._seen: deque[tuple[float, Place]] = deque(maxlen=30)
        self._pose = self.create_publisher(Odometry, "pose", NEWEST)
        self._amcl_pose = self.create_lifecycle_publisher(PoseWithCovarianceStamped, "amcl_pose", 10)
        self._account = self.create_lifecycle_publisher(String, "amcl/account", 10)
        self._tf = self.create_lifecycle_publisher(TFMessage, "tf", 10)
        self.create_subscription(Odometry, "odom", self._on_odom, NEWEST)
        self.create_subscription(PoseStamped, "marker", self._on_marker, 10)
        self.create_timer(0.1, self._tell)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go on with the newest state of the replica that acted before, or begin clean."""
        self._correction, self._restored_age_s = Place(), None
        return super().on_activate(state)

    def take_state(self, version: int, data: bytes) -> None:
        """Take the correction that the replica on the other side knew."""
        if version != VERSION or len(data) != STATE.size:
            raise ValueError(f"{len(data)} bytes of version {version}")
        *where, made_s = STATE.unpack(data)
        if not all(map(math.isfinite, where)):
            raise ValueError("a place that is no number")
        self._correction = Place(*where)
        self._restored_age_s = self._now_s() - made_s

    def _on_odom(self, odom: Odometry) -> None:
        seen = place(odom.pose.pose)
        self._seen.append((_seconds(odom), seen))
        if self._account.is_activated:
            odom.header.frame_id = "map"
            odom.pose.pose = posed(self._correction.then(seen), odom.header.stamp).pose
            self._pose.publish(odom)

    def _on_marker(self, marker: PoseStamped) -> None:
        if self._account.is_activated and self._seen:
            stamp_s = _seconds(marker)
            _, seen = min(self._seen, key=lambda entry: abs(entry[0] - stamp_s))
            self._correction = place(marker.pose).then(seen.inverse())

    def _tell(self) -> None:
        if not self._account.is_activated:
            return
        known = self._correction
        self.publish_state(VERSION, STATE.pack(known.x_m, known.y_m, known.yaw_rad, self._now_s()))
        account = {"node": self.get_name(), "restored_age_s": self._restored_age_s, "at_s": self._now_s()}
        self._account.publish(String(data=json.dumps(account)))
        where = transform("map", "odom", known)
        where.header.stamp = self._wall.now().to_msg()
        self._tf.publish(TFMessage(transforms=[where]))
        if self._seen:
            said = PoseWithCovarianceStamped()
            here = posed(known.then(self._seen[-1][1]), where.header.stamp)
            said.header, said.pose.pose = here.header, here.pose
            self._amcl_pose.publish(said)

    def _now_s(self) -> float:
        now_s: float = self._wall.now().nanoseconds / 1e9
        return now_s


def _seconds(stamped: object) -> float:
    stamp = stamped.header.stamp  # type: ignore[attr-defined]  # ROS messages have no types
    seconds: float = stamp.sec + stamp.nanosec / 1e9
    return seconds
