"""One number for the same control period on every robot of a team, without synchronised clocks."""


class TeamTick:
    """Numbers the team's ticks: a robot counts its own periods and never stays behind what it hears.

    Whoever started first leads, the others adopt its number from its frames (Lamport's clock, in periods).
    Two robots have the same number within one period, by which their grids may be apart, plus the delay of
    the frames; lost frames do not matter, for each robot counts on by its own clock. A robot whose clock is
    slow, or that ticks at a lower rate, skips numbers: what is agreed for a tick happens at the first tick
    of that number or above.

    Args:
        period_s: the robot's control period.
    """

    def __init__(self, period_s: float) -> None:
        self.number = 0
        self._period_s = period_s
        self._zero_s: float | None = None

    def advance(self, now_s: float) -> None:
        """Begin a tick; ``now_s`` is monotonic. Waking late by less than half a period changes nothing."""
        if self._zero_s is None:
            self._zero_s = now_s
        self.number = max(self.number, round((now_s - self._zero_s) / self._period_s))

    def heard(self, number: int) -> None:
        """Take in a teammate's number; after the first `advance`."""
        ahead = number - self.number
        if ahead > 0 and self._zero_s is not None:
            self._zero_s -= ahead * self._period_s
            self.number = number
