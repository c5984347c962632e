"""What the robot sees: a point cloud that becomes a scan, images for the detector in the cloud, a costmap of both."""

import json
import math
import time

import numpy as np
from nav_msgs.msg import OccupancyGrid, Odometry
from places import Place, place  # type: ignore[import-not-found]  # beside this script, as all that follow
from sedia_interfaces.srv import ClearCostmap, GetCostmap
from sensor_msgs.msg import CompressedImage, LaserScan, PointCloud2
from serving import LATCHED, NEWEST, Managed  # type: ignore[import-not-found]
from std_msgs.msg import String

KEPT_S = 8.0
"""So long the costmap remembers what it has seen."""
FAR_M = 3.0
BEAMS = 30
HEIGHTS_M = (0.1, 0.6)
SIDE = 128
"""Of the detector's pictures and matrices; 256 took a third of a core of a slow computer that carries both sides."""


class PointcloudToLaserscan(Managed):
    """Makes a flat scan (`depth_scan`) of the points between knee and seat."""

    def __init__(self) -> None:
        super().__init__("pointcloud_to_laserscan")
        self._scan = self.create_publisher(LaserScan, "depth_scan", NEWEST)
        self.create_subscription(PointCloud2, "points", self._flatten, NEWEST)

    def _flatten(self, cloud: PointCloud2) -> None:
        if not self.acting:
            return
        points = np.frombuffer(bytes(cloud.data), dtype=np.float32).reshape(-1, 3)
        points = points[(points[:, 2] > HEIGHTS_M[0]) & (points[:, 2] < HEIGHTS_M[1])]
        angles = np.arctan2(points[:, 1], points[:, 0])
        scan = LaserScan(header=cloud.header, angle_min=-math.pi / 4, angle_max=math.pi / 4, range_max=FAR_M)
        scan.angle_increment = (scan.angle_max - scan.angle_min) / BEAMS
        ranges = np.full(BEAMS, np.inf)
        beams = np.clip((angles - scan.angle_min) / scan.angle_increment, 0, BEAMS - 1).astype(int)
        np.minimum.at(ranges, beams, np.hypot(points[:, 0], points[:, 1]))
        scan.ranges = ranges.tolist()
        self._scan.publish(scan)


class Costmap(Managed):
    """The map, and what the flat scan has seen lately (`local_costmap`); serves `clear_costmap` and `get_costmap`."""

    def __init__(self) -> None:
        super().__init__("costmap")
        self._map: OccupancyGrid | None = None
        self._walls = np.zeros((1, 1), dtype=np.int8)
        self._seen_s = np.zeros((1, 1))
        self._here: Place | None = None
        self._costmap = self.create_publisher(OccupancyGrid, "local_costmap", LATCHED)
        self.create_subscription(OccupancyGrid, "map", self._on_map, LATCHED)
        self.create_subscription(Odometry, "pose", self._on_pose, NEWEST)
        self.create_subscription(LaserScan, "depth_scan", self._on_scan, NEWEST)
        self.create_service(ClearCostmap, "clear_costmap", self._clear)
        self.create_service(GetCostmap, "get_costmap", self._get)
        self.every(1.0, self._tell)

    def _on_map(self, said: OccupancyGrid) -> None:
        self._walls = np.asarray(said.data, dtype=np.int8).reshape(said.info.height, said.info.width)
        self._seen_s, self._map = np.full(self._walls.shape, -math.inf), said

    def _on_pose(self, said: Odometry) -> None:
        self._here = place(said.pose.pose) if self.acting else None

    def _on_scan(self, scan: LaserScan) -> None:
        if not self.acting or self._here is None or self._map is None:
            return
        ranges = np.asarray(scan.ranges)
        angles = self._here.yaw_rad + scan.angle_min + scan.angle_increment * (np.arange(ranges.size) + 0.5)
        hit = np.isfinite(ranges) & (ranges < FAR_M)
        info = self._map.info
        columns = (self._here.x_m + ranges[hit] * np.cos(angles[hit]) - info.origin.position.x) / info.resolution
        rows = (self._here.y_m + ranges[hit] * np.sin(angles[hit]) - info.origin.position.y) / info.resolution
        inside = (rows >= 0) & (rows < info.height) & (columns >= 0) & (columns < info.width)
        self._seen_s[rows[inside].astype(int), columns[inside].astype(int)] = time.monotonic()

    def _now(self) -> OccupancyGrid:
        assert self._map is not None
        lately = time.monotonic() - self._seen_s < KEPT_S
        cells = np.where(lately, np.maximum(self._walls, 60), self._walls)
        return OccupancyGrid(header=self._map.header, info=self._map.info, data=cells.ravel().tolist())

    def _tell(self) -> None:
        if self._map is not None:
            self._costmap.publish(self._now())

    def _clear(self, _request: ClearCostmap.Request, response: ClearCostmap.Response) -> ClearCostmap.Response:
        response.cleared = int(np.isfinite(self._seen_s).sum())
        self._seen_s[:] = -math.inf
        return response

    def _get(self, _request: GetCostmap.Request, response: GetCostmap.Response) -> GetCostmap.Response:
        if self._map is not None:
            response.map = self._now()
        return response


class Detector(Managed):
    """Looks for people in images, in the cloud only: what it computes is too heavy for the robot.

    The numbers stand in for a network: a matrix product per layer, no answer that anybody could use.
    """

    def __init__(self) -> None:
        super().__init__("detector")
        self._layers = np.random.default_rng(1).standard_normal((self.declare_parameter("layers", 4).value, SIDE, SIDE))
        self._number = 0
        self._detections = self.create_publisher(String, "detections", 10)
        self.create_subscription(CompressedImage, "camera/image/compressed", self._look, NEWEST)

    def _look(self, image: CompressedImage) -> None:
        if not self.acting:
            return
        began_s = time.monotonic()
        seen = np.resize(np.frombuffer(bytes(image.data), dtype=np.uint8), (SIDE, SIDE)).astype(np.float64)
        for layer in self._layers:
            seen = np.tanh(layer @ seen / SIDE)
        self._number += 1
        said = {"people": int(seen.sum() > 0), "took_ms": round((time.monotonic() - began_s) * 1e3, 1)}
        self._detections.publish(String(data=json.dumps({"number": self._number, **said})))
