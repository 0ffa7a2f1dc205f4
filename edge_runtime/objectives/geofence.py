"""Stay out of a disc."""

import math

from edge_runtime.messages import Vector2
from edge_runtime.motion.outlook import Outlook, PredictedMotion
from edge_runtime.objectives.objective import Objective, Slope


class Geofence(Objective, frozen=True, kw_only=True, tag="geofence"):
    """Keep the robot's centre out of a disc: J = 1/2 (depth / position gain)^2."""

    look_ahead: int = 4
    centre_m: Vector2
    """Of the disc."""
    radius_m: float
    """Of the disc."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the disc."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("radius_m")
        self.require_not_negative("buffer_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
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
