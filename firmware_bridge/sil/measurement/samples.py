"""What a process beside the team records while it lasts, in memory that it takes and touches beforehand."""

import math
from array import array

MARGIN_S = 30.0
"""From the beginning of a record to that of the measurement, and from its end to the record's."""
LONGEST_S = 3600.0
"""Memory is taken beforehand for so long a run; what lasts longer grows by what comes after."""


class Samples:
    """Numbers in the order in which they come.

    A process that grows while it measures what others grow by, and that meets new pages while it serves
    them, disturbs what it is to judge.

    Args:
        rate_hz: how many come in a second.
        duration_s: of the run.
    """

    def __init__(self, rate_hz: float, duration_s: float) -> None:
        room = math.ceil(rate_hz * min(duration_s + MARGIN_S, LONGEST_S))
        self._values = array("d", bytes(8 * room))
        self._count = 0

    def append(self, value: float) -> None:
        """Take in the next one."""
        if self._count < len(self._values):
            self._values[self._count] = value
        else:
            self._values.append(value)
        self._count += 1

    def tolist(self) -> list[float]:
        """Return all."""
        return self._values[: self._count].tolist()
