"""What a policy has not seen: an observation that lies outside of the ranges which training had.

A policy answers any numbers with confidence, also those of a world that it was not trained for. Ranges are
the bundle's, component by component; fields without are never called unfamiliar.
"""

from collections.abc import Sequence
from itertools import accumulate
from typing import Final

import msgspec
import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.observation import ObservationField

LEAST_WIDTH: Final = 1e-3
"""In the field's unit; how far a component lies outside counts in half the width of its range."""
ANYTHING: Final = float(np.finfo(np.float32).max)
"""What a component of an unknown range may be; not infinite, which could not be subtracted from itself."""


class Unfamiliar(msgspec.Struct, frozen=True, gc=False):
    """What an observation holds that training never had."""

    field: str = ""
    """The one that lies furthest outside; empty if none does."""
    seconds: float = 0.0
    """For how long now, without a tick inside."""


FAMILIAR: Final = Unfamiliar()


def knows_training(fields: Sequence[ObservationField]) -> bool:
    """Whether a policy says of any field what it saw in training."""
    return any(field.seen is not None for field in fields)


class Familiarity:
    """Judges one robot's observations, tick by tick.

    Args:
        fields: of the policy's manifest, in its order.
    """

    def __init__(self, fields: Sequence[ObservationField]) -> None:
        self._names = [field.name for field in fields]
        self._ends = np.array(list(accumulate(field.size for field in fields)))
        anything = (-ANYTHING, ANYTHING)
        ranges = [pair for field in fields for pair in field.seen or (anything,) * field.size]
        low, high = np.array(ranges, np.float32).T
        self._known = knows_training(fields)
        self._low, self._high = low.copy(), high.copy()
        self._width = np.maximum(0.5 * high - 0.5 * low, LEAST_WIDTH)
        self._excess, self._below = np.empty_like(low), np.empty_like(low)
        self._since_s: float | None = None

    def strangest(self, observation: Array) -> str:
        """Return the field of an observation (O,) that lies furthest outside of its range; empty if none."""
        if not self._known:
            return ""
        excess = self._excess
        np.subtract(observation, self._high, out=excess)
        np.subtract(self._low, observation, out=self._below)
        np.maximum(excess, self._below, out=excess)
        if not excess.max() > 0.0:
            return ""
        worst = int((excess / self._width).argmax())
        return self._names[int(np.searchsorted(self._ends, worst, "right"))]

    def follow(self, field: str, now_s: float) -> Unfamiliar:
        """Take the strangest field of one tick's observation into account; ticks come in order."""
        if not field:
            self._since_s = None
            return FAMILIAR
        if self._since_s is None:
            self._since_s = now_s
        return Unfamiliar(field, now_s - self._since_s)
