"""How often an autopilot's pose comes, and how often a control rate needs it."""

import math
from collections import deque
from typing import Final

LONGEST_PERIODS: Final = 3
LONGEST_S: Final = 0.1
"""A pose may come this seldom, in control periods and in seconds: no robot acts on an older one."""
WATCH_S: Final = 1.0
"""Over which the interval is taken."""


def longest_pose_s(period_s: float) -> float:
    """Return the greatest interval of poses at which a control period drives."""
    return min(LONGEST_PERIODS * period_s, LONGEST_S)


class PoseRate:
    """Follows the arrival of poses.

    Args:
        period_s: of control.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._poses_s: deque[float] = deque()

    def hear(self, now_s: float) -> None:
        """Take note of a pose."""
        self._poses_s.append(now_s)
        while len(self._poses_s) > 2 and now_s - self._poses_s[1] > WATCH_S:
            self._poses_s.popleft()

    def suffices(self, now_s: float) -> bool:
        """Whether they come often enough."""
        return self._interval_s(now_s) <= longest_pose_s(self._period_s)

    def shortfall(self, now_s: float) -> str:
        """Say at which interval they come and at which they should."""
        interval_s = self._interval_s(now_s)
        seen = f"every {1e3 * interval_s:.0f} ms" if interval_s < math.inf else "not even once a second"
        rate_hz, longest_ms = 1.0 / self._period_s, 1e3 * longest_pose_s(self._period_s)
        return f"its pose comes {seen}, but --rate {rate_hz:g} needs one every {longest_ms:.0f} ms"

    def _interval_s(self, now_s: float) -> float:
        """Return the mean interval, or the time since the last pose where that is longer."""
        if len(self._poses_s) < 2:
            return math.inf
        first_s, last_s = self._poses_s[0], self._poses_s[-1]
        return max((last_s - first_s) / (len(self._poses_s) - 1), now_s - last_s)
