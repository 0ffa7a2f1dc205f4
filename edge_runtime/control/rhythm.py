"""When poses come: the rhythm of their source."""

import math
from collections import deque
from typing import Final

SAME_PLACE: Final = 0.15
"""Poses a period that differ less from a whole number come at the same places of each period."""
REMEMBERED: Final = 5
"""Intervals that tell the source's rhythm."""
MISSING: Final = 1.5
"""In an interval so many times as long as the median a pose was lost; the others' mean is the rhythm."""
LATE: Final = 0.15
"""Share of an interval by which a pose may come later than expected."""
LOST: Final = 3
"""So many poses may be lost in a row before none is expected any more."""


class Rhythm:
    """When poses come, told by the newest ones.

    Args:
        together_s: poses that come within this time count as one.
    """

    def __init__(self, together_s: float) -> None:
        self.newest_s = -math.inf
        self.interval_s = math.inf
        """Between two poses; infinite until that is known."""
        self._together_s, self._counted_s = together_s, -math.inf
        self._intervals: deque[float] = deque(maxlen=REMEMBERED)

    def heard(self, pose_s: float) -> None:
        """Take in when a pose was measured."""
        self.newest_s = max(self.newest_s, pose_s)
        interval_s = pose_s - self._counted_s
        if interval_s < self._together_s:
            return
        self._counted_s = pose_s
        if interval_s < math.inf:
            self._intervals.append(interval_s)
        if len(self._intervals) == REMEMBERED:
            longest_s = MISSING * sorted(self._intervals)[REMEMBERED // 2]
            whole = [interval_s for interval_s in self._intervals if interval_s < longest_s]
            self.interval_s = sum(whole) / len(whole)

    def repeats(self, period_s: float) -> bool:
        """Whether several poses come in each period, always at the same places of it."""
        poses = period_s / self.interval_s
        return poses > 1.5 and abs(poses - round(poses)) < SAME_PLACE

    def next_s(self, after_s: float, now_s: float) -> float:
        """Return when the first pose after a time is expected, or a little before it; infinite if none is."""
        if not now_s - self._counted_s <= (1 + LOST) * self.interval_s < math.inf:
            return math.inf
        ahead = math.ceil((after_s - self._counted_s) / self.interval_s - LATE)
        return self._counted_s + max(1, ahead) * self.interval_s
