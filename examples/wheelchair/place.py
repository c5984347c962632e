"""Places in the plane, seen from one another."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """A place and a heading; as a correction: where the origin of the odometry is in the corridor."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def then(self, other: "Place") -> "Place":
        """Return `other`, which was seen from here, as it is seen from where this place was seen."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x_m = self.x_m + cosine * other.x_m - sine * other.y_m
        y_m = self.y_m + sine * other.x_m + cosine * other.y_m
        return Place(x_m, y_m, math.remainder(self.yaw_rad + other.yaw_rad, math.tau))

    def inverse(self) -> "Place":
        """Return the place from which this one was seen, as it is seen from here."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x_m, y_m = cosine * self.x_m + sine * self.y_m, cosine * self.y_m - sine * self.x_m
        return Place(-x_m, -y_m, -self.yaw_rad)
