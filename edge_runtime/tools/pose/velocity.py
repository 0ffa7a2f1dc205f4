"""Velocity from tracked positions: the slope of a straight line through the newest ones."""

import math
from collections import deque
from typing import Final

from edge_runtime.messages import Vector

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
        self._samples: deque[tuple[float, ...]] = deque()

    def add(self, stamp_s: float, position_m: Vector) -> Vector | None:
        """Take in a position and return the velocity in m/s; None until there are enough."""
        samples = self._samples
        if samples and not CLOSEST_S <= stamp_s - samples[-1][0] <= GAP_S:
            samples.clear()
        samples.append((stamp_s, *position_m))
        while len(samples) > LEAST and stamp_s - samples[0][0] > WINDOW_S:
            samples.popleft()
        return self._slope() if len(samples) >= LEAST else None

    def _slope(self) -> Vector:
        times, *axes = zip(*self._samples, strict=True)
        middle = sum(time_s - times[0] for time_s in times) / len(times)
        apart = [time_s - times[0] - middle for time_s in times]
        spread = sum(t * t for t in apart)
        return tuple(sum(t * x for t, x in zip(apart, axis, strict=True)) / spread for axis in axes)


class MotionFit:
    """Follows one body that turns."""

    def __init__(self) -> None:
        self._fit, self._heading_rad = VelocityFit(), 0.0

    def add(self, stamp_s: float, position_m: Vector, heading_rad: float) -> tuple[Vector, float] | None:
        """Take in a pose and return velocity in m/s and yaw rate in rad/s; None until there are enough."""
        turned = math.remainder(heading_rad - self._heading_rad, math.tau)
        self._heading_rad += turned  # goes on where the heading wraps
        found = self._fit.add(stamp_s, (*position_m, self._heading_rad))
        return None if found is None else (found[:-1], found[-1])
