"""Keep the team's cluster at a radius: the mean distance of its robots to their centroid."""

import math
from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope

COINCIDENT_M = 1e-9
"""Closer to the centroid than this, rounding alone would decide a robot's direction from it."""


class Clustering(Objective, frozen=True, kw_only=True, tag="clustering"):
    """Keep the cluster radius R of the n robots in sight, oneself included, at a target.

    J = 1/2 ((R - target) / position gain)^2, half the squared action with which each of n robots takes its
    share of the cure. The centroid moves by 1/n of the own motion, so that the slope lies along the own
    direction from the centroid less the mean of all directions, and is 1/n as steep as a single robot's
    objective: all robots act on the same deviation, and together they must not overshoot. Alone there is
    nothing to keep.
    """

    preference: ClassVar[bool] = True
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 4
    radius_m: float
    """Mean distance of the robots to their centroid."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("radius_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        mates, gain = outlook.neighbours, outlook.preview.position_gain
        if not mates:
            return Slope(0.0)
        count = len(mates) + 1
        middle_x = (motion.x + sum(mate.x for mate in mates)) / count
        middle_y = (motion.y + sum(mate.y for mate in mates)) / count
        middle_z = (motion.z + sum(mate.z for mate in mates)) / count
        members = [(outlook.robot_id, motion.x, motion.y, motion.z)]
        members += [(mate.robot_id, mate.x, mate.y, mate.z) for mate in mates]
        total = sum_x = sum_y = sum_z = own_x = own_y = own_z = 0.0
        for index, (robot_id, x, y, z) in enumerate(members):
            dx, dy, dz = x - middle_x, y - middle_y, z - middle_z
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            total += distance
            if distance < COINCIDENT_M:  # no direction leads out: the robots' order decides
                angle = 2.0 * math.pi * sum(other < robot_id for other, *_ in members) / count
                dx, dy, dz, distance = math.cos(angle), math.sin(angle), 0.0, 1.0
            dx, dy, dz = dx / distance, dy / distance, dz / distance
            sum_x, sum_y, sum_z = sum_x + dx, sum_y + dy, sum_z + dz
            if index == 0:
                own_x, own_y, own_z = dx, dy, dz
        cure = (total / count - self.radius_m) / gain
        push = cure / (gain * count)
        d_x, d_y, d_z = (
            push * (own - outward / count)
            for own, outward in ((own_x, sum_x), (own_y, sum_y), (own_z, sum_z))
        )
        return Slope(0.5 * cure * cure, d_x, d_y, 0.0, 0.0, d_z)

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.radius_m, COINCIDENT_M)
