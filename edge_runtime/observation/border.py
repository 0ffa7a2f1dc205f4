"""The border of the arena that a policy was trained in: places beyond are observed on it.

A policy that is told where it is knows only its training's places. Beyond them it may be lost, though all
else that it observes is as it was; told that it stands on the border, it goes on as it does there.
"""

from collections.abc import Sequence

import msgspec
import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.messages import Place
from edge_runtime.observation import ObservationField, Position


class Arena(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A box, by two of its corners."""

    low_m: Place
    """The least place on each axis."""
    high_m: Place
    """The greatest place on each axis."""

    def __post_init__(self) -> None:
        check_bounds(self, dict.fromkeys(("low_m", "high_m"), (-GREATEST, GREATEST)))
        if len(self.low_m) != len(self.high_m):
            raise ValueError("`high_m` must have as many components as `low_m`")
        if not all(low < high for low, high in zip(self.low_m, self.high_m, strict=True)):
            raise ValueError("`high_m` must be greater than `low_m` on each axis")


def observes_place(fields: Sequence[ObservationField]) -> bool:
    """Whether a policy is told where its robot is."""
    return any(isinstance(field, Position) for field in fields)


class Border:
    """Limits the robot's own place in observations, and nothing else.

    Args:
        fields: of the policy's manifest, in its order.
        arena: in the robot's metres, of its axes; without one, and for a policy that is not told its place,
            nothing is limited.
        scale_m: one of the policy's metres, in the robot's.
    """

    def __init__(
        self, fields: Sequence[ObservationField], arena: Arena | None = None, scale_m: float = 1.0
    ) -> None:
        self.limits = arena is not None and observes_place(fields)
        """Whether anything is limited."""
        low: list[float] = []
        high: list[float] = []
        for field in fields:
            inside = arena if isinstance(field, Position) else None
            low += inside.low_m if inside else (-np.inf,) * field.size
            high += inside.high_m if inside else (np.inf,) * field.size
        self._low, self._high = (np.array([low, high]) / scale_m).astype(np.float32)

    def clamp(self, observation: Array) -> None:
        """Bring places in observations (n, O) to the nearest inside, axis by axis."""
        if self.limits:
            np.maximum(observation, self._low, out=observation)
            np.minimum(observation, self._high, out=observation)
