"""What touches the hardware, here a simulation that they share: wheels, scanner, odometry."""

import json
import math
import time
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from places import Place, posed, transform  # type: ignore[import-not-found]  # beside this script, as all that follow
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rooms import LENGTH_M, WIDTH_M, Building, CeilingMarks  # type: ignore[import-not-found]
from sensor_msgs.msg import BatteryState, CompressedImage, Imu, Joy, LaserScan, PointCloud2, PointField
from serving import COMMANDS, LATCHED, NEWEST, Managed  # type: ignore[import-not-found]
from std_msgs.msg import String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage
from world import LIDAR_RANGE_M, Driver, WheelOdometry  # type: ignore[import-not-found]

STEP_S = 0.05
MAX_CATCH_UP_S = 0.2
DRIFT = 0.05
SCAN_S = 0.1
DEPTH_M = 3.0
"""How far the depth camera sees."""
IMAGE_BYTES = 4000


class Simulation:
    """The building and the wheels' own safety; one for all drivers of a process."""

    def __init__(self, seed: int) -> None:
        self.building = Building(seed)
        self.driver = Driver()
        self.odometry = WheelOdometry(self.building, DRIFT)
        self.marks = CeilingMarks()


class WheelsControl(Managed):
    """Obeys `cmd_vel` and `wheels_control/inhibit`; `sedia/state` is how the drive goes (JSON). Parameter: `seed`."""

    simulation: Simulation

    def __init__(self) -> None:
        super().__init__("wheels_control")
        WheelsControl.simulation = Simulation(self.declare_parameter("seed", 0).value)
        self._last_s, self._ran_s = time.monotonic(), 0.0
        self._marker = self.create_publisher(PoseStamped, "marker", 10)
        self._state = self.create_publisher(String, "sedia/state", 10)
        self.create_subscription(TwistStamped, "cmd_vel", self._on_command, COMMANDS)
        self.create_service(SetBool, "wheels_control/inhibit", self._on_inhibit)
        self.create_timer(STEP_S, self._step)
        self.create_timer(0.1, self._say)

    def _on_command(self, command: TwistStamped) -> None:
        self.simulation.driver.command(time.monotonic(), command.twist.linear.x, command.twist.angular.z)

    def _on_inhibit(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.simulation.driver.inhibited = request.data
        response.success, response.message = True, "wheels are inhibited" if request.data else "wheels obey commands"
        return response

    def _step(self) -> None:
        now_s = time.monotonic()
        elapsed_s, self._last_s = min(now_s - self._last_s, MAX_CATCH_UP_S), now_s
        self._ran_s += elapsed_s
        simulation, building = self.simulation, self.simulation.building
        steps = math.ceil(elapsed_s / 0.025)
        for _ in range(steps):
            building.step(elapsed_s / steps, *simulation.driver.wanted(now_s, building.speed_mps))
            simulation.odometry.follow(building)
        if self.acting and simulation.marks.passed(building.x_m, building.y_m):
            where = Place(building.x_m, building.y_m, building.yaw_rad)
            self._marker.publish(posed(where, self.wall.now().to_msg()))

    def _say(self) -> None:
        building, driver = self.simulation.building, self.simulation.driver
        state: dict[str, Any] = {
            "t_s": round(self._ran_s, 3),
            "x": round(building.x_m, 3),
            "y": round(building.y_m, 3),
            "yaw": round(building.yaw_rad, 3),
            "speed": round(building.speed_mps, 3),
            "collisions": building.collisions,
            "stops": driver.stops,
            "inhibited": driver.inhibited,
            "goal_reached": building.goal_reached,
            "goal": list(building.goal),
            "corridor": {"length": LENGTH_M, "width": WIDTH_M},
            "walls": building.walls.tolist(),
            "obstacles": [[round(it.x_m, 3), round(it.y_m, 3), it.radius_m] for it in building.visible],
        }
        self._state.publish(String(data=json.dumps(state)))


class Lidar(Managed):
    """Publishes `scan`."""

    def __init__(self) -> None:
        super().__init__("lidar")
        self._scan = self.create_publisher(LaserScan, "scan", COMMANDS)
        self.every(SCAN_S, self._look)

    def _look(self) -> None:
        building = WheelsControl.simulation.building
        angles = building.beam_angles
        scan = LaserScan(scan_time=SCAN_S, range_min=0.01, range_max=LIDAR_RANGE_M)
        scan.header.stamp, scan.header.frame_id = self.wall.now().to_msg(), "base_link"
        scan.angle_min, scan.angle_max = float(angles[0]), float(angles[-1])
        scan.angle_increment = float(angles[1] - angles[0])
        scan.ranges = building.scan().tolist()
        self._scan.publish(scan)


class WheelOdometer(Managed):
    """Publishes `odom` and the transform odom -> base_link: where the wheels believe to be."""

    def __init__(self) -> None:
        super().__init__("odometry")
        self._count = 0
        self._tf = self.create_publisher(TFMessage, "tf", 10)
        self._odom = self.create_publisher(Odometry, "odom", 10)
        self.every(STEP_S, self._tell)

    def _tell(self) -> None:
        building, believed = WheelsControl.simulation.building, WheelsControl.simulation.odometry
        odom = Odometry(child_frame_id="base_link")
        odom.header.stamp, odom.header.frame_id = self.wall.now().to_msg(), "odom"
        wheels = Place(believed.x_m, believed.y_m, believed.yaw_rad)
        odom.pose.pose = posed(wheels, odom.header.stamp).pose
        odom.twist.twist.linear.x, odom.twist.twist.angular.z = building.speed_mps, building.yaw_rate_radps
        self._odom.publish(odom)
        self._count += 1
        if self._count % 2 == 0:
            where = transform("odom", "base_link", wheels)
            where.header.stamp = odom.header.stamp
            self._tf.publish(TFMessage(transforms=[where]))


class DepthCamera(Managed):
    """Publishes `points`: what stands within 45 degrees ahead, as columns of points."""

    def __init__(self) -> None:
        super().__init__("depth_camera")
        self._points = self.create_publisher(PointCloud2, "points", NEWEST)
        self.every(0.5, self._look)

    def _look(self) -> None:
        building = WheelsControl.simulation.building
        ranges, angles = building.scan(), building.beam_angles
        seen = (np.abs(angles) < math.pi / 4) & (ranges < DEPTH_M)
        flat = np.stack((ranges[seen] * np.cos(angles[seen]), ranges[seen] * np.sin(angles[seen])), axis=1)
        columns = [np.column_stack((flat, np.full(len(flat), height))) for height in (0.05, 0.3, 1.0)]
        points = np.concatenate(columns).astype(np.float32)
        cloud = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points), is_dense=True)
        cloud.header.stamp, cloud.header.frame_id = self.wall.now().to_msg(), "base_link"
        cloud.fields = [PointField(name=it, offset=4 * i, datatype=7, count=1) for i, it in enumerate("xyz")]
        cloud.data = points.tobytes()
        self._points.publish(cloud)


class Camera(Managed):
    """Publishes `camera/image/compressed`; the bytes stand in for a picture."""

    def __init__(self) -> None:
        super().__init__("camera")
        self._image = self.create_publisher(CompressedImage, "camera/image/compressed", NEWEST)
        self.every(0.5, self._shoot)

    def _shoot(self) -> None:
        building = WheelsControl.simulation.building
        image = CompressedImage(format="jpeg", data=bytes(np.resize(np.uint8(building.x_m * 20), IMAGE_BYTES)))
        image.header.stamp, image.header.frame_id = self.wall.now().to_msg(), "camera"
        self._image.publish(image)


class InertialUnit(Managed):
    """Publishes `imu`: how fast the wheelchair turns."""

    def __init__(self) -> None:
        super().__init__("imu")
        self._imu = self.create_publisher(Imu, "imu", NEWEST)
        self.every(0.2, self._tell)

    def _tell(self) -> None:
        said = Imu()
        said.header.stamp, said.header.frame_id = self.wall.now().to_msg(), "base_link"
        said.angular_velocity.z = WheelsControl.simulation.building.yaw_rate_radps
        self._imu.publish(said)


class Joystick(Managed):
    """Publishes `joy`: the stick on the armrest, which nobody touches here."""

    def __init__(self) -> None:
        super().__init__("joystick")
        self._joy = self.create_publisher(Joy, "joy", 10)
        self.every(1.0, lambda: self._joy.publish(Joy(axes=[0.0, 0.0], buttons=[0])))


class Battery(Managed):
    """Publishes `battery_state`: an hour and a half of driving."""

    def __init__(self) -> None:
        super().__init__("battery")
        self._charge = 1.0
        self._battery = self.create_publisher(BatteryState, "battery_state", 10)
        self.every(1.0, self._tell)

    def _tell(self) -> None:
        self._charge = max(0.0, self._charge - 1.0 / 5400.0)
        self._battery.publish(BatteryState(percentage=self._charge, voltage=24.0, present=True))


class RobotStatePublisher(Managed):
    """Publishes `tf_static`: where scanner and camera are fixed."""

    def __init__(self) -> None:
        super().__init__("robot_state_publisher")
        self._tf = self.create_publisher(TFMessage, "tf_static", LATCHED)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the transforms."""
        fixed = [transform("base_link", name, Place(0.2)) for name in ("laser", "camera")]
        self._tf.publish(TFMessage(transforms=fixed))
        return super().on_activate(state)
