"""Keep one distance to the closest neighbour."""

import math
from typing import ClassVar

import numpy as np

from edge_runtime.motion.outlook import Floats, Motion, Outlook, OutlookBatch
from edge_runtime.objectives.objective import Objective, Slope, SlopeBatch


class Spacing(Objective, frozen=True, kw_only=True, tag="spacing"):
    """Have the closest neighbour at a distance between centres: J = 1/2 (deviation / position gain)^2."""

    preference: ClassVar[bool] = True
    look_ahead: int = 4
    distance_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.distance_m <= 0.0:
            raise ValueError(f"`distance_m` must be positive, got {self.distance_m}")

    def evaluate(self, motion: Motion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        nearest, dx, dy, order = math.inf, 0.0, 0.0, 1.0
        for mate in outlook.neighbours:
            mate_dx, mate_dy = motion.x - mate.x, motion.y - mate.y
            square = mate_dx * mate_dx + mate_dy * mate_dy
            if square < nearest:
                nearest, dx, dy, order = square, mate_dx, mate_dy, outlook.robot_id - mate.robot_id
        if nearest == math.inf:
            return Slope(0.0)
        gain, distance = outlook.preview.position_gain, math.sqrt(nearest)
        cure = (self.distance_m - distance) / gain
        if distance == 0.0:  # no direction leads apart: the robots' order decides
            dx, distance = math.copysign(1.0, order), 1.0
        push = cure / (gain * distance)
        return Slope(0.5 * cure * cure, -push * dx, -push * dy)

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions."""
        if outlook.mate_id.shape[1] == 0:
            nothing = np.zeros_like(position_m)
            return SlopeBatch(nothing[:, 0], nothing, nothing)
        apart = position_m[:, None] - outlook.mate_position_m
        square, rows = np.square(apart).sum(-1), np.arange(len(apart))
        closest = square.argmin(1)
        away, distance = apart[rows, closest], np.sqrt(square[rows, closest])
        gain = outlook.preview.position_gain
        cure = (self.distance_m - distance) / gain
        together = distance == 0.0
        order = np.where(outlook.robot_id < outlook.mate_id[rows, closest], -1.0, 1.0)
        away[:, 0] = np.where(together, order, away[:, 0])
        push = cure / (gain * np.where(together, 1.0, distance))
        return SlopeBatch(0.5 * np.square(cure), -push[:, None] * away, np.zeros_like(velocity_m_s))
