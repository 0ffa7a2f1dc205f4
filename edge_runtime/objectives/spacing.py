"""Keep one distance to the closest neighbour."""

import math
from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class Spacing(Objective, frozen=True, kw_only=True, tag="spacing"):
    """Have the closest neighbour at a distance between centres: J = 1/2 (deviation / position gain)^2."""

    preference: ClassVar[bool] = True
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 4
    distance_m: float
    """Between the centres, to the closest neighbour."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        nearest, dx, dy, dz, order = math.inf, 0.0, 0.0, 0.0, 1.0
        for mate in outlook.neighbours:
            mate_dx, mate_dy, mate_dz = motion.x - mate.x, motion.y - mate.y, motion.z - mate.z
            square = mate_dx * mate_dx + mate_dy * mate_dy + mate_dz * mate_dz
            if square < nearest:
                nearest, dx, dy, dz = square, mate_dx, mate_dy, mate_dz
                order = outlook.robot_id - mate.robot_id
        if nearest == math.inf:
            return Slope(0.0)
        gain, distance = outlook.preview.position_gain, math.sqrt(nearest)
        cure = (self.distance_m - distance) / gain
        if distance == 0.0:  # no direction leads apart: the robots' order decides
            dx, distance = math.copysign(1.0, order), 1.0
        push = cure / (gain * distance)
        return Slope(0.5 * cure * cure, -push * dx, -push * dy, 0.0, 0.0, -push * dz)

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.distance_m,)
