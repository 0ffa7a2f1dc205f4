"""The cost of being too near to points, and the base of the objectives that have it."""

import math
from collections.abc import Iterable
from typing import ClassVar

from edge_runtime.common.vectors import new_tuple
from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Neighbour, Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class Clearance(Objective, frozen=True, kw_only=True):
    """Keep a distance from points: J = 1/2 sum (shortfall / position gain)^2."""

    of: ClassVar[Quantity] = "position"
    look_ahead: int = 3
    distance_m: float
    """Of the robot's centre from the other robots' or the object's, or from the surface that is seen."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")
        self.require_not_negative("buffer_m")

    def points(self, outlook: Outlook) -> Iterable[Neighbour]:
        """What to keep clear of."""
        raise NotImplementedError

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        return keep_clear(motion, self.points(outlook), self.distance_m + self.buffer_m, outlook)

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.distance_m + self.buffer_m,)


def keep_clear(
    motion: PredictedMotion, points: Iterable[Neighbour], keep_m: float, outlook: Outlook
) -> Slope:
    """J = 1/2 sum over points nearer than ``keep_m`` of (shortfall / position gain)^2.

    At one place the order of their numbers decides in which direction along x to leave it.
    """
    x, y, _, _, z, _, _, _ = motion
    gain, cost, d_x, d_y, d_z, near = outlook.preview.position_gain, 0.0, 0.0, 0.0, 0.0, keep_m * keep_m
    for point in points:
        robot_id, to_x, to_y, _, _, to_z, _, _, _ = point
        dx, dy, dz = x - to_x, y - to_y, z - to_z
        square = dx * dx + dy * dy + dz * dz
        if square < near:
            distance = math.sqrt(square)
            cure = (keep_m - distance) / gain
            cost += 0.5 * cure * cure
            if distance == 0.0:
                dx, distance = math.copysign(1.0, outlook.robot_id - robot_id), 1.0
            push = cure / (gain * distance)
            d_x -= push * dx
            d_y -= push * dy
            d_z -= push * dz
    return new_tuple(Slope, (cost, d_x, d_y, 0.0, 0.0, d_z, 0.0, 0.0, 0.0))


def standing(x: float, y: float, z: float, outlook: Outlook) -> Neighbour:
    """A point that is no robot; robots at it leave in the direction of x."""
    return Neighbour(outlook.robot_id - 1, x, y, 0.0, 0.0, z)
