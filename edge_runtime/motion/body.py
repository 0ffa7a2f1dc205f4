"""The robot that a policy was trained for."""

import math

import msgspec
import numpy as np

from edge_runtime.motion.range_sensor import RangeSensor


class Body(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Its disc and its range sensor."""

    radius_m: float
    """Of its disc."""
    lidar_rays: int
    """How many, evenly spread; 0 for none."""
    lidar_range_m: float
    """Of each ray; 0 without rays."""
    lidar_start_rad: float = 0.0
    """Direction of the first ray, from x counter-clockwise; the others follow evenly."""

    def sensor(self) -> RangeSensor:
        """Prepare its range sensor, which may have no rays."""
        angle = self.lidar_start_rad + np.arange(self.lidar_rays) * (2.0 * math.pi / max(self.lidar_rays, 1))
        rays = tuple(zip(np.cos(angle).tolist(), np.sin(angle).tolist(), strict=True))
        return RangeSensor(rays, self.lidar_range_m, self.radius_m)
