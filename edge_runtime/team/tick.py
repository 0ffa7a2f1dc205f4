"""One number for the same control period on every robot of a team, without synchronised clocks."""

from typing import Final

from edge_runtime.network.seal import FrameError, Refusal

STEP: Final = 1000
"""A teammate may be ahead by so many ticks at any time: those of a second, at most."""
LEAP: Final = 2**32
"""And by so many where teams meet: those of a year at 100 Hz. Adopting them does no harm."""
LEAP_S: Final = 1.0
"""A teammate may leap by `LEAP` in each such time since it last did; one that leaps on is kept out."""


class TeamTick:
    """Numbers the team's ticks: a robot counts its own periods and never stays behind what it hears.

    Whoever started first leads, the others adopt its number from its frames (Lamport's clock, in periods).
    Two robots have the same number within one period, by which their grids may be apart, plus the delay of
    the frames; lost frames do not matter, for each robot counts on by its own clock. A robot whose clock is
    slow, or that ticks at a lower rate, skips numbers: what is agreed for a tick happens at the first tick
    of that number or above.

    Numbers only rise, so one too high for anybody to count on from would be the end of the team's frames.
    Whom to believe when one is far ahead, the one or the rest, cannot be told: who starts alone and is joined
    hours later is right. So leaps are adopted, but not so fast that they lead anywhere near the last number.
    What a teammate may leap by grows while it is kept out: whoever has fallen behind comes after in the end.

    Args:
        period_s: the robot's control period.
    """

    def __init__(self, period_s: float) -> None:
        self.number = 0
        self._period_s = period_s
        self._zero_s: float | None = None
        self._leaped_s: dict[int, float] = {}

    def advance(self, now_s: float) -> None:
        """Begin a tick of a monotonic time; less than half a period later it is still the same."""
        if self._zero_s is None:
            self._zero_s = now_s
        self.number = max(self.number, round((now_s - self._zero_s) / self._period_s))

    def hear(self, robot_id: int, number: int, now_s: float) -> None:
        """Take in a teammate's number; after the first `advance`.

        Raises:
            FrameError: if the teammate leaps farther than the time since its last leap allows.
        """
        ahead = number - self.number
        if ahead > STEP:
            leaped_s = self._leaped_s.setdefault(robot_id, now_s - LEAP_S)
            if ahead > LEAP * (now_s - leaped_s) / LEAP_S:
                raise FrameError(Refusal.TICK_LEAPS)
            self._leaped_s[robot_id] = now_s
        if ahead > 0 and self._zero_s is not None:
            self._zero_s -= ahead * self._period_s
            self.number = number
