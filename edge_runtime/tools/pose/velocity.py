"""Velocity from tracked positions: the slope of a straight line through the newest ones."""

from collections import deque
from typing import Final

from edge_runtime.messages import Vector2

WINDOW_S: Final = 0.05
"""Positions of this time are fitted: the velocity is that of its middle, 25 ms ago."""
LEAST: Final = 3
"""At least so many are fitted, however slowly they come."""
GAP_S: Final = 0.5
"""After a longer gap the fit starts anew."""
CLOSEST_S: Final = 1e-4
"""After a shorter one too: no system measures so often, and no slope rests on it."""


class VelocityFit:
    """Follows one body."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque()

    def add(self, stamp_s: float, position_m: Vector2) -> Vector2 | None:
        """Take in a position and return the velocity in m/s; None until there are enough."""
        samples = self._samples
        if samples and not CLOSEST_S <= stamp_s - samples[-1][0] <= GAP_S:
            samples.clear()
        samples.append((stamp_s, *position_m))
        while len(samples) > LEAST and stamp_s - samples[0][0] > WINDOW_S:
            samples.popleft()
        return self._slope() if len(samples) >= LEAST else None

    def _slope(self) -> Vector2:
        count, origin_s = len(self._samples), self._samples[0][0]
        rows = [(stamp_s - origin_s, x, y) for stamp_s, x, y in self._samples]
        middle = sum(t for t, _, _ in rows) / count
        spread = sum((t - middle) ** 2 for t, _, _ in rows)
        return (
            sum((t - middle) * x for t, x, _ in rows) / spread,
            sum((t - middle) * y for t, _, y in rows) / spread,
        )
