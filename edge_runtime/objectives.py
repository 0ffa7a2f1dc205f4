"""Execution objectives: costs of a robot's predicted motion, with analytic gradients.

An objective states its cost J and dJ/d(position, velocity) of the motion that it predicts ``look_ahead``
control steps ahead; the chain rule through the dynamics and the flow is the runtime's (eq. 11). The
built-in costs are half the squared action that would cure the violation, so that one guidance scale means
the same to all of them.

To add one, subclass `Objective` and write ``evaluate``; ``evaluate_batch`` is only for speed.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np

from edge_runtime.scene import Floats, Motion, Outlook, OutlookBatch

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
        ValueError: if a number is not finite, the weight is negative, or ``look_ahead`` is out of range.
    """

    weight: float = 1.0
    """lambda_m, the preference weight (eq. 4)."""
    look_ahead: int = 1
    """How many control steps ahead the motion is predicted."""

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"`{field}` must be finite, got {value}")
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


class SpeedLimit(Objective, frozen=True, kw_only=True, tag="speed_limit"):
    """Stay at or below a speed: J = 1/2 (excess / velocity gain)^2."""

    limit_m_s: float
    buffer_m_s: float = 0.01
    """Guidance starts this far below the limit."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.buffer_m_s < self.limit_m_s:
            raise ValueError(
                f"`buffer_m_s` must lie in [0, limit_m_s), got {self.buffer_m_s} of {self.limit_m_s}"
            )

    def evaluate(self, motion: Motion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        speed = math.sqrt(motion.vx * motion.vx + motion.vy * motion.vy)
        excess = speed - self.limit_m_s + self.buffer_m_s
        if excess <= 0.0:
            return Slope(0.0)
        cure = excess / outlook.preview.velocity_gain
        pull = cure / (outlook.preview.velocity_gain * speed)
        return Slope(0.5 * cure * cure, 0.0, 0.0, pull * motion.vx, pull * motion.vy)

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions."""
        speed = np.sqrt(np.square(velocity_m_s).sum(-1))
        gain = outlook.preview.velocity_gain
        cure = np.maximum(speed - self.limit_m_s + self.buffer_m_s, 0.0) / gain
        pull = cure / (gain * np.maximum(speed, self.limit_m_s - self.buffer_m_s))
        return SlopeBatch(0.5 * cure * cure, np.zeros_like(position_m), pull[:, None] * velocity_m_s)


class SafetyMargin(Objective, frozen=True, kw_only=True, tag="safety_margin"):
    """Keep a distance between centres from every neighbour: J = 1/2 sum (shortfall / position gain)^2."""

    look_ahead: int = 3
    distance_m: float
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.distance_m <= 0.0 or self.buffer_m < 0.0:
            raise ValueError(
                f"`distance_m` must be positive and `buffer_m` not negative, "
                f"got {self.distance_m} and {self.buffer_m}"
            )

    def evaluate(self, motion: Motion, outlook: Outlook) -> Slope:
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

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions."""
        gain = outlook.preview.position_gain
        apart = position_m[:, None] - outlook.mate_position_m
        distance = np.sqrt(np.square(apart).sum(-1))
        cure = np.maximum(self.distance_m + self.buffer_m - distance, 0.0) / gain
        together = distance == 0.0
        order = np.where(outlook.robot_id[:, None] < outlook.mate_id, -1.0, 1.0)
        apart[..., 0] = np.where(together, order, apart[..., 0])
        push = cure / (gain * np.where(together, 1.0, distance))
        slope = -(push[..., None] * apart).sum(1)
        return SlopeBatch(0.5 * np.square(cure).sum(-1), slope, np.zeros_like(velocity_m_s))


BUILT_IN = (SpeedLimit, SafetyMargin)
"""The objectives that configuration files can name by their ``type``."""
