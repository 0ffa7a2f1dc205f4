"""The border of the arena that a policy was trained in: places beyond are observed on it.

A policy that is told where it is knows only its training's places. Beyond them it may be lost, though all
else that it observes is as it was; told that it stands on the border, it goes on as it does there.
"""

from collections.abc import Sequence

import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.common.bounds import GREATEST
from edge_runtime.observation import ObservationField, Position

Arena = tuple[tuple[float, float], ...]
"""Least and greatest place on each axis, in m."""


def check_arena(arena: Arena) -> None:
    """Check what a file calls a training's arena.

    Raises:
        ValueError: if it is none.
    """
    if not all(-GREATEST <= low < high <= GREATEST for low, high in arena):
        raise ValueError(
            f"`training_arena_m` must be [least, greatest] place on each axis, within {GREATEST:g} m, "
            f"got {[list(ends) for ends in arena]}"
        )


def observes_place(fields: Sequence[ObservationField]) -> bool:
    """Whether a policy is told where its robot is."""
    return any(isinstance(field, Position) for field in fields)


class Border:
    """Limits the robot's own place in observations, and nothing else.

    Args:
        fields: of the policy's manifest, in its order.
        arena: in the robot's metres; without one, and for a policy that is not told its place, nothing is
            limited.
        scale_m: one of the policy's metres, in the robot's.
    """

    def __init__(self, fields: Sequence[ObservationField], arena: Arena = (), scale_m: float = 1.0) -> None:
        self.limits = bool(arena) and observes_place(fields)
        """Whether anything is limited."""
        bounds: list[tuple[float, float]] = []
        for field in fields:
            limited = self.limits and isinstance(field, Position)
            bounds += arena if limited else [(-np.inf, np.inf)] * field.size
        self._low, self._high = (np.array(bounds) / scale_m).astype(np.float32).T.copy()

    def clamp(self, observation: Array) -> None:
        """Bring places in observations (n, O) to the nearest inside, axis by axis."""
        if self.limits:
            np.maximum(observation, self._low, out=observation)
            np.minimum(observation, self._high, out=observation)
