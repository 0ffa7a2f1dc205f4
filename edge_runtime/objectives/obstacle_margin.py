"""Keep clear of whatever the range sensor sees that is not a teammate."""

import math
from collections.abc import Sequence
from typing import ClassVar

from edge_runtime.motion.outlook import Outlook, PredictedMotion
from edge_runtime.objectives.objective import Objective, Slope


class ObstacleMargin(Objective, frozen=True, kw_only=True, tag="obstacle_margin"):
    """Keep a distance from obstacles: J = 1/2 sum over what is seen of (shortfall / position gain)^2.

    Obstacles are points on their surfaces, that stand still, see `Outlook.obstacles`; the distance counts
    from there to the robot's centre.
    """

    kernel_term: ClassVar[str] = "safety_margin"
    look_ahead: int = 3
    distance_m: float
    """From the robot's centre to the surface that is seen."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")
        self.require_not_negative("buffer_m")

    @property
    def sight_m(self) -> float:
        """How far from its centre the robot must see obstacles."""
        return self.distance_m + self.buffer_m

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        keep, gain = self.distance_m + self.buffer_m, outlook.preview.position_gain
        cost = d_x = d_y = 0.0
        for x, y in outlook.obstacles:
            dx, dy = motion.x - x, motion.y - y
            square = dx * dx + dy * dy
            if square < keep * keep:
                distance = math.sqrt(square)
                cure = (keep - distance) / gain
                cost += 0.5 * cure * cure
                if distance == 0.0:  # no direction leads away: take x
                    dx, distance = 1.0, 1.0
                push = cure / (gain * distance)
                d_x -= push * dx
                d_y -= push * dy
        return Slope(cost, d_x, d_y)

    def encode(self, outlook: Outlook) -> Sequence[float]:
        """The numbers of `SafetyMargin.encode`: to the kernel obstacles are neighbours."""
        numbers = [self.distance_m + self.buffer_m, outlook.drift.x, outlook.drift.y]
        for x, y in outlook.obstacles:
            numbers += (x, y, 1.0)
        return numbers
