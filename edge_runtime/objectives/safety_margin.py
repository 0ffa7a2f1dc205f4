"""Keep a distance from every neighbour."""

import math
from collections.abc import Sequence
from typing import ClassVar

from edge_runtime.motion.outlook import Outlook, PredictedMotion
from edge_runtime.objectives.objective import Objective, Slope


class SafetyMargin(Objective, frozen=True, kw_only=True, tag="safety_margin"):
    """Keep a distance between centres from every neighbour: J = 1/2 sum (shortfall / position gain)^2."""

    kernel_term: ClassVar[str] = "safety_margin"
    look_ahead: int = 3
    distance_m: float
    """Between the centres of two robots."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")
        self.require_not_negative("buffer_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        keep, gain = self.distance_m + self.buffer_m, outlook.preview.position_gain
        cost = d_x = d_y = 0.0
        for mate in outlook.neighbours:
            dx, dy = motion.x - mate.x, motion.y - mate.y
            square = dx * dx + dy * dy
            if square < keep * keep:
                distance = math.sqrt(square)
                cure = (keep - distance) / gain
                cost += 0.5 * cure * cure
                if distance == 0.0:  # no direction leads apart: the robots' order decides
                    dx, distance = math.copysign(1.0, outlook.robot_id - mate.robot_id), 1.0
                push = cure / (gain * distance)
                d_x -= push * dx
                d_y -= push * dy
        return Slope(cost, d_x, d_y)

    def encode(self, outlook: Outlook) -> Sequence[float]:
        """The distance at which guidance starts, the position without action, and what each neighbour adds.

        That is its position, and the side along x on which to leave it if the positions coincide.
        """
        numbers = [self.distance_m + self.buffer_m, outlook.drift.x, outlook.drift.y]
        for mate in outlook.neighbours:
            numbers += (mate.x, mate.y, math.copysign(1.0, outlook.robot_id - mate.robot_id))
        return numbers
