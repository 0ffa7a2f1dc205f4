"""Whether a robot is measured to go faster than the guard lets it be commanded."""

import math
from typing import Final

from edge_runtime.messages import RobotState

SHARE: Final = 1.25
MARGIN_M_S: Final = 0.05
"""Above so much more than the limit it is no overshoot of a controller."""
PATIENCE_S: Final = 0.5
"""Nor if it lasts longer than this."""


class Speeding:
    """Follows the measured speed: a stick that nudges, a slope, or firmware that does not hold its setpoint.

    Args:
        limit_m_s: greatest speed that is commanded.
    """

    def __init__(self, limit_m_s: float) -> None:
        self._limit_m_s = limit_m_s
        self._kept_s: float | None = None

    def fault(self, state: RobotState | None, now_s: float) -> str:
        """Say how fast it goes, if that is too fast for too long; empty otherwise."""
        speed = 0.0 if state is None else math.hypot(*state.velocity_m_s)
        if self._kept_s is None or speed <= SHARE * self._limit_m_s + MARGIN_M_S:
            self._kept_s = now_s
        if now_s - self._kept_s <= PATIENCE_S:
            return ""
        return f"the robot goes at {speed:.2f} m/s, over the limit of {self._limit_m_s:g} m/s"
