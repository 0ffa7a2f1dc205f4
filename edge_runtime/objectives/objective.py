"""The base of execution objectives: costs of a robot's predicted motion, with analytic gradients.

An objective states its cost J and dJ/d(position, velocity) of the motion that it predicts ``look_ahead``
control steps ahead; the chain rule through the dynamics and the flow is the runtime's (eq. 11). The
built-in costs are half the squared action that would cure the violation, so that one guidance scale means
the same to all of them.
"""

import math
from typing import ClassVar, NamedTuple

import msgspec
import numpy as np

from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.motion.outlook import Floats, Motion, Outlook, OutlookBatch

LONGEST_LOOK_AHEAD = 1000
"""Steps; a constant action has long lost its meaning there."""


class Slope(NamedTuple):
    """A cost and its derivatives with respect to the robot's own predicted motion."""

    cost: float
    d_x: float = 0.0
    d_y: float = 0.0
    d_vx: float = 0.0
    d_vy: float = 0.0


class SlopeBatch(NamedTuple):
    """The batched `Slope`: cost (B,), d_position (B, 2), d_velocity (B, 2)."""

    cost: Floats
    d_position: Floats
    d_velocity: Floats


class Objective(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="type"):
    """Base of every execution objective.

    Raises:
        ValueError: if a number is not finite or absurdly large, the weight is negative, or ``look_ahead``
            is out of range.
    """

    preference: ClassVar[bool] = False
    """Whether this is a wish and no requirement: it moves actions by `GuidanceSettings.reach` at most, and
    yields to what is required."""
    weight: float = 1.0
    """lambda_m, the preference weight (eq. 4)."""
    look_ahead: int = 1
    """How many control steps ahead the motion is predicted."""

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"`{field}` must be finite, got {value}")
            if isinstance(value, float | tuple):
                check_bounds(self, {field: (-GREATEST, GREATEST)})
        if self.weight < 0.0:
            raise ValueError(f"`weight` must not be negative, got {self.weight}")
        if not 1 <= self.look_ahead <= LONGEST_LOOK_AHEAD:
            raise ValueError(f"`look_ahead` must lie in [1, {LONGEST_LOOK_AHEAD}], got {self.look_ahead}")

    @property
    def name(self) -> str:
        """The name under which configuration and reports know this objective."""
        return str(self.__struct_config__.tag or type(self).__name__)

    def evaluate(self, motion: Motion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        raise NotImplementedError(f"{type(self).__name__} must define evaluate(motion, outlook)")

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions: positions (B, 2), velocities (B, 2)."""
        motions = np.concatenate([position_m, velocity_m_s], -1).tolist()
        slopes = [self.evaluate(Motion(*motion), outlook.row(i)) for i, motion in enumerate(motions)]
        table = np.array(slopes, np.float64).reshape(-1, 5)
        return SlopeBatch(table[:, 0], table[:, 1:3], table[:, 3:5])
