"""Who wants something of the robot: the patrol, and the screen that a person looks at."""

import contextlib
import json
import time
from typing import Any

from errands import Errand, Errands  # type: ignore[import-not-found]  # of the wheelchair
from geometry_msgs.msg import PoseWithCovarianceStamped
from places import Place, moved, posed  # type: ignore[import-not-found]  # beside this script
from rclpy.action import ActionClient
from sedia_interfaces.action import NavigateToPose
from sedia_interfaces.srv import ClearCostmap
from sensor_msgs.msg import BatteryState
from serving import LATCHED, NEWEST, Managed  # type: ignore[import-not-found]
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

SAY_S = 0.1
REST_S = 0.5
CLEAR_S = 10.0


class WaypointFollower(Managed):
    """Drives to one place after the other and counts what it hears of that (`waypoint_follower/account`, JSON).

    An ordinary client: it knows one server of `navigate_to_pose`, wherever that is. Parameter: `waypoints`, x and y in
    turns.
    """

    def __init__(self) -> None:
        super().__init__("waypoint_follower")
        flat = list(self.declare_parameter("waypoints", [2.0, 1.0]).value)
        self._places = list(zip(flat[::2], flat[1::2], strict=True))
        self._errands = Errands()
        self._rested_s = 0.0
        self._navigate = ActionClient(self, NavigateToPose, "navigate_to_pose")
        self._said = self.create_publisher(String, "waypoint_follower/account", 10)
        self.every(SAY_S, self._tell)

    def _tell(self) -> None:
        rested = time.monotonic() - self._rested_s > REST_S
        if self._errands.present is None and self._places and rested and self._navigate.server_is_ready():
            self._send(*self._places.pop(0))
        self._said.publish(String(data=self._errands.text()))

    def _send(self, x_m: float, y_m: float) -> None:
        errand = self._errands.begin()
        goal = NavigateToPose.Goal(pose=posed(Place(x_m, y_m), self.wall.now().to_msg()))
        sent = self._navigate.send_goal_async(goal, feedback_callback=lambda said: self._on_feedback(errand, said))
        sent.add_done_callback(lambda future: self._on_answer(errand, future.result()))

    def _on_answer(self, errand: Errand, handle: Any) -> None:
        self._errands.answered(errand, accepted=handle.accepted)
        if handle.accepted:
            handle.get_result_async().add_done_callback(lambda future: self._on_result(errand, future.result().status))

    def _on_feedback(self, errand: Errand, message: Any) -> None:
        said = message.feedback
        at = said.pose.pose.position
        self._errands.heard(errand, said.process, said.tick, at.x, at.y)

    def _on_result(self, errand: Errand, status: int) -> None:
        self._errands.ended(errand, status)
        self._rested_s = time.monotonic()


class Hmi(Managed):
    """The screen: shows where the wheelchair is, what is going on and why (`hmi/shown`), and clears the costmap."""

    def __init__(self) -> None:
        super().__init__("hmi")
        self._lines: dict[str, str] = {}
        self._seen: dict[str, Place] = {}
        self._clear = self.create_client(ClearCostmap, "clear_costmap")
        self._shown = self.create_publisher(String, "hmi/shown", 10)
        self.create_subscription(PoseWithCovarianceStamped, "amcl_pose", self._on_pose, NEWEST)
        self.create_subscription(TFMessage, "tf", self._on_transforms, 10)
        self.create_subscription(BatteryState, "battery_state", self._on_battery, 10)
        self.create_subscription(String, "detections", lambda said: self._show("seen", said.data), 10)
        self.create_subscription(String, "/offload/placement", self._on_placement, LATCHED)
        self.every(1.0, lambda: self._shown.publish(String(data=json.dumps(self._lines))))
        self.every(CLEAR_S, self._tidy)

    def _show(self, what: str, text: str) -> None:
        self._lines[what] = text

    def _on_pose(self, said: PoseWithCovarianceStamped) -> None:
        at = said.pose.pose.position
        self._show("place", f"{at.x:.1f} m, {at.y:.1f} m")

    def _on_transforms(self, said: TFMessage) -> None:
        self._seen |= {where.child_frame_id: moved(where.transform) for where in said.transforms}
        if {"odom", "base_link"} <= self._seen.keys():
            at = self._seen["odom"].then(self._seen["base_link"])
            self._show("place by the transforms", f"{at.x_m:.1f} m, {at.y_m:.1f} m")

    def _on_battery(self, said: BatteryState) -> None:
        self._show("battery", f"{said.percentage:.0%}")

    def _on_placement(self, said: String) -> None:
        with contextlib.suppress(ValueError, KeyError, TypeError):
            placement = json.loads(said.data)
            self._show("why", f"{placement['site']}: {placement['message']}")

    def _tidy(self) -> None:
        if self._clear.service_is_ready():
            self._clear.call_async(ClearCostmap.Request())
