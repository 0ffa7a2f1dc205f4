"""The cost of being too near to points, which several objectives share."""

import math
from collections.abc import Iterable, Sequence

from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Slope

Point = tuple[float, float, float, float]
"""x, y and z in m, and the side along x, 1 or -1, on which to leave it if the positions coincide."""


def keep_clear(motion: PredictedMotion, points: Iterable[Point], keep_m: float, outlook: Outlook) -> Slope:
    """J = 1/2 sum over points nearer than ``keep_m`` of (shortfall / position gain)^2."""
    gain = outlook.preview.position_gain
    cost = d_x = d_y = d_z = 0.0
    for x, y, z, side in points:
        dx, dy, dz = motion.x - x, motion.y - y, motion.z - z
        square = dx * dx + dy * dy + dz * dz
        if square < keep_m * keep_m:
            distance = math.sqrt(square)
            cure = (keep_m - distance) / gain
            cost += 0.5 * cure * cure
            if distance == 0.0:
                dx, distance = side, 1.0
            push = cure / (gain * distance)
            d_x -= push * dx
            d_y -= push * dy
            d_z -= push * dz
    return Slope(cost, d_x, d_y, 0.0, 0.0, d_z)


def encode_clear(points: Iterable[Point], keep_m: float, outlook: Outlook) -> Sequence[float]:
    """The kernel's numbers: the distance, the position without action, and each point with its side."""
    dims = outlook.preview.dims
    numbers = [keep_m, *outlook.drift.position_m(dims)]
    for x, y, z, side in points:
        numbers += (x, y, side) if dims == 2 else (x, y, z, side)
    return numbers
