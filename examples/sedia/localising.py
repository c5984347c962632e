"""Where the robot is, and the map that it is on."""

from geometry_msgs.msg import PoseWithCovarianceStamped
from localiser import Localiser  # type: ignore[import-not-found]  # of the wheelchair
from nav_msgs.msg import OccupancyGrid
from places import posed, transform  # type: ignore[import-not-found]  # beside this script, as all that follow
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rooms import CELL_M, WIDTH_M, grid  # type: ignore[import-not-found]
from serving import LATCHED, Managed  # type: ignore[import-not-found]
from tf2_msgs.msg import TFMessage


class MapServer(Managed):
    """Publishes `map` once, for all who come."""

    def __init__(self) -> None:
        super().__init__("map_server")
        self._map = self.create_publisher(OccupancyGrid, "map", LATCHED)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publishes the map."""
        cells = grid()
        message = OccupancyGrid(data=cells.ravel().tolist())
        message.header.frame_id = "map"
        message.info.resolution = CELL_M
        message.info.height, message.info.width = cells.shape
        message.info.origin.position.y = -WIDTH_M / 2
        self._map.publish(message)
        return super().on_activate(state)


class Amcl(Localiser):  # type: ignore[misc]
    """Corrects odometry at each mark that it passes. What it knows of the drift is its state: it survives a change.

    Publishes `pose` for its own side, `amcl_pose` and the transform map -> odom for everybody, and `amcl/account`: how
    old the state was with which it began.
    """

    def __init__(self) -> None:
        super().__init__("amcl", start_parameter_services=False)
        self._amcl_pose = self.create_lifecycle_publisher(PoseWithCovarianceStamped, "amcl_pose", 10)
        self._tf = self.create_lifecycle_publisher(TFMessage, "tf", 10)

    def _tell(self) -> None:
        super()._tell()
        if not self._tf.is_activated:
            return
        known = self._correction
        where = transform("map", "odom", known)
        where.header.stamp = self._wall.now().to_msg()
        self._tf.publish(TFMessage(transforms=[where]))
        if self._odometry:
            said = PoseWithCovarianceStamped()
            here = posed(known.then(self._odometry[-1][1]), where.header.stamp)
            said.header, said.pose.pose = here.header, here.pose
            self._amcl_pose.publish(said)
