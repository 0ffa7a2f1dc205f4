"""Stay out of a disc."""

import math

import numpy as np

from edge_runtime.messages import Vector2
from edge_runtime.motion.outlook import Floats, Motion, Outlook, OutlookBatch
from edge_runtime.objectives.objective import Objective, Slope, SlopeBatch


class Geofence(Objective, frozen=True, kw_only=True, tag="geofence"):
    """Keep the robot's centre out of a disc: J = 1/2 (depth / position gain)^2."""

    look_ahead: int = 4
    centre_m: Vector2
    radius_m: float
    buffer_m: float = 0.02
    """Guidance starts this far outside the disc."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.radius_m <= 0.0 or self.buffer_m < 0.0:
            raise ValueError(
                f"`radius_m` must be positive and `buffer_m` not negative, "
                f"got {self.radius_m} and {self.buffer_m}"
            )

    def evaluate(self, motion: Motion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        dx, dy = motion.x - self.centre_m[0], motion.y - self.centre_m[1]
        keep, square = self.radius_m + self.buffer_m, dx * dx + dy * dy
        if square >= keep * keep:
            return Slope(0.0)
        distance, gain = math.sqrt(square), outlook.preview.position_gain
        cure = (keep - distance) / gain
        if distance == 0.0:  # every direction leads out: take x
            dx, distance = 1.0, 1.0
        push = cure / (gain * distance)
        return Slope(0.5 * cure * cure, -push * dx, -push * dy)

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions."""
        gain = outlook.preview.position_gain
        offset = position_m - self.centre_m
        distance = np.sqrt(np.square(offset).sum(-1))
        cure = np.maximum(self.radius_m + self.buffer_m - distance, 0.0) / gain
        amid = distance == 0.0
        offset[:, 0] = np.where(amid, 1.0, offset[:, 0])
        push = cure / (gain * np.where(amid, 1.0, distance))
        return SlopeBatch(0.5 * cure * cure, -push[:, None] * offset, np.zeros_like(velocity_m_s))
