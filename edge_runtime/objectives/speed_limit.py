"""Stay at or below a speed."""

import math
from typing import ClassVar

from edge_runtime.common.vectors import new_tuple
from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class SpeedLimit(Objective, frozen=True, kw_only=True, tag="speed_limit"):
    """Stay at or below a speed: J = 1/2 (excess / velocity gain)^2."""

    sees_team: ClassVar[bool] = False
    of: ClassVar[Quantity] = "velocity"
    limit_m_s: float
    """The greatest speed that is asked for."""
    buffer_m_s: float = 0.01
    """Guidance starts this far below the limit."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("limit_m_s")
        self.require_not_negative("buffer_m_s")
        if self.buffer_m_s >= self.limit_m_s:
            raise ValueError(
                f"`buffer_m_s` must be below `limit_m_s`, got {self.buffer_m_s} of {self.limit_m_s}"
            )

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        vx, vy, vz = motion.vx, motion.vy, motion.vz
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        excess = speed - self.limit_m_s + self.buffer_m_s
        if excess <= 0.0:
            return Slope(0.0)
        cure = excess / outlook.preview.velocity_gain
        pull = cure / (outlook.preview.velocity_gain * speed)
        return new_tuple(Slope, (0.5 * cure * cure, 0.0, 0.0, pull * vx, pull * vy, 0.0, pull * vz, 0.0, 0.0))

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.limit_m_s, self.buffer_m_s)
