"""How old another machine's measurement is, without trusting its clock."""

import math
from typing import Final

DRIFT: Final = 200e-6
"""Greatest rate at which two machines' clocks part: a crystal is off by at most 100 parts in a million."""


class RemoteClock:
    """Another machine's monotonic clock in terms of ours.

    The lag of a message is its arrival by our clock minus its stamp by theirs: the unknown offset of the
    clocks plus the message's delay. The message with the smallest lag is taken to have come without delay,
    so an age is too small by the least delay that any message had, and never too large. What is remembered
    as smallest rises slowly, for clocks drift apart.
    """

    def __init__(self) -> None:
        self._least_lag_s = math.inf
        self._arrival_s = -math.inf
        self._stamp_s = -math.inf

    def heard(self, stamp_s: float, arrival_s: float) -> None:
        """Take in a message; messages must come in the order of their sequence."""
        lag = arrival_s - stamp_s
        if stamp_s >= self._stamp_s:
            risen = self._least_lag_s + DRIFT * (arrival_s - self._arrival_s)
            self._least_lag_s = min(risen, lag)
        else:  # messages are in order, so it was their clock that went back: start anew
            self._least_lag_s = lag
        self._stamp_s, self._arrival_s = stamp_s, arrival_s

    def local_s(self, stamp_s: float) -> float:
        """Return our time at their ``stamp_s``; there must have been a message."""
        return stamp_s + self._least_lag_s
