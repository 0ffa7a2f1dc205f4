"""The deadline grid that paces the loop, and the record of where each tick's time went."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

STEP: Final = 0.1
"""Share of a period by which a deadline is put off at most."""
SLOWER: Final = 1e-3
"""Share of the ticks that putting deadlines off may cost: five times what two machines' clocks part by."""


class DeadlineGrid:
    """Absolute deadlines, one a period: late ticks are skipped and counted, never made up for.

    Args:
        period_s: distance between deadlines.
        clock: monotonic time in seconds.
        sleep: waits for a number of seconds; may return late.
    """

    def __init__(
        self,
        period_s: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.period_s = period_s
        self.ticks = 0
        self.misses = 0
        self.longest_burst = 0
        """Most deadlines missed in a row."""
        self.due_s = 0.0
        """When the newest tick was to begin."""
        self._clock, self._sleep = clock, sleep
        self._first: float | None = None
        self._origin = 0.0  # later than the first deadline where the deadlines followed something
        self._index = 0
        self._wish_s, self._allowed_s = 0.0, period_s  # what deadlines are still to be put off by, and may be

    @property
    def next_s(self) -> float:
        """When the next deadline comes, counted from the first."""
        return 0.0 if self._first is None else self._passed_s + self.period_s

    @property
    def rate_hz(self) -> float:
        """Ticks per second from the first to the newest; 0 before there are two."""
        return (self.ticks - 1) / self._passed_s if self.ticks > 1 else 0.0

    def wait(self) -> float:
        """Wait until the next deadline still ahead and return its time.

        The first call sets the grid's origin and returns at once. A tick counts as missed if the caller
        came after its deadline, or if the wait lasted beyond its whole period; a wait that long returns
        the newest deadline, which has just passed.
        """
        self.ticks += 1
        if self._first is None:
            self._first = self._origin = self.due_s = self._clock()
            return self._origin
        before = self._slots
        self._postpone()
        elapsed = self._clock() - self._origin
        self._index = max(self._index + 1, math.ceil(elapsed / self.period_s))
        self.due_s = self._origin + self._index * self.period_s
        self._reach(self.due_s)
        elapsed = self._clock() - self._origin
        self._index = max(self._index, math.floor(elapsed / self.period_s))
        missed = self._slots - before - 1
        self.misses += missed
        self.longest_burst = max(self.longest_burst, missed)
        deadline_s = self._origin + self._index * self.period_s
        self.due_s = max(self.due_s, deadline_s)
        return deadline_s

    @property
    def _passed_s(self) -> float:
        """Time from the first deadline to the newest."""
        return self._origin - (self._first or 0.0) + self._index * self.period_s

    @property
    def _slots(self) -> int:
        """Whole periods from the first deadline to the newest: one that was put off by a period is missed."""
        return self._index + math.floor((self._origin - (self._first or 0.0)) / self.period_s)

    def _reach(self, deadline_s: float) -> None:
        """Wait until the tick is to begin, less than a period after its deadline."""
        self._sleep_until(deadline_s)

    def _sleep_until(self, time_s: float) -> None:
        self._sleep(max(0.0, time_s - self._clock()))

    def _postpone(self) -> None:
        """Put all further deadlines off as is wished, in small steps.

        By a period in all, and a little: nobody who is followed slows the ticks down.
        """
        step_s = min(self._wish_s, STEP * self.period_s, self._allowed_s)
        self._origin += step_s
        self._allowed_s = min(self.period_s, self._allowed_s - step_s + SLOWER * self.period_s)
        self._wish_s -= step_s


class Percentiles(msgspec.Struct, frozen=True):
    """A distribution in a few numbers."""

    p50: float
    p99: float
    p99_9: float
    max: float


class TimingRecord:
    """Durations of each tick and its stages in microseconds, in rings allocated beforehand.

    Args:
        stages: names in the order of a tick.
        capacity: ticks that the percentiles look back on; the maxima are those of the whole run.
        clock: monotonic time in seconds.
    """

    def __init__(
        self,
        stages: Sequence[str],
        capacity: int = 16384,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.stages = ("wake", *stages)
        self._clock = clock
        self._ring = np.zeros((capacity, len(self.stages) + 1), np.float32)
        self._ring.fill(0.0)  # touch every page now, not in the loop
        self._max = [0.0] * (len(self.stages) + 1)
        self._laps: list[float] = []
        self._ticks = 0
        self._start = self._last = 0.0

    def begin(self, deadline_s: float) -> None:
        """Start a tick that was due at ``deadline_s``: the stage ``wake`` is how late it starts."""
        self._start = self._last = self._clock()
        self._laps = [(self._start - deadline_s) * 1e6]

    def lap(self) -> None:
        """End the tick's next stage."""
        now = self._clock()
        self._laps.append((now - self._last) * 1e6)
        self._last = now

    def end(self) -> float:
        """End the tick and return how long it took, in microseconds; it must have had all its stages."""
        total = (self._last - self._start) * 1e6
        self._laps.append(total)
        self._ring[self._ticks % len(self._ring)] = self._laps
        self._max = [max(pair) for pair in zip(self._max, self._laps, strict=True)]
        self._ticks += 1
        return total

    @property
    def laps(self) -> list[float]:
        """Durations of the newest tick's stages and of the whole, in microseconds; valid after `end`."""
        return self._laps

    def tick_us(self) -> Percentiles:
        """Distribution of whole ticks, from wake-up to the command's departure."""
        return self._percentiles(len(self.stages))

    def stage_us(self) -> dict[str, Percentiles]:
        """Distribution of every stage."""
        return {name: self._percentiles(column) for column, name in enumerate(self.stages)}

    def recent_us(self, ticks: int) -> list[tuple[float, float]]:
        """Median and 99th percentile of each stage, then of the whole tick, over the newest ``ticks``.

        Made for the loop: after a sleep, numpy's own percentiles take it four times as long.
        """
        kept = min(ticks, self._ticks, len(self._ring))
        if not kept:
            return [(0.0, 0.0)] * (len(self.stages) + 1)
        rows = self._ring[np.arange(self._ticks - kept, self._ticks) % len(self._ring)]
        rows.sort(axis=0)
        return list(zip(_quantiles(rows, 0.5), _quantiles(rows, 0.99), strict=True))

    def _percentiles(self, column: int) -> Percentiles:
        kept = self._ring[: min(self._ticks, len(self._ring)), column]
        if not len(kept):
            return Percentiles(0.0, 0.0, 0.0, 0.0)
        p50, p99, p99_9 = np.percentile(kept, [50.0, 99.0, 99.9]).tolist()
        return Percentiles(p50, p99, p99_9, self._max[column])


def _quantiles(rows: npt.NDArray[np.float32], share: float) -> list[float]:
    """Each column's quantile, between the two values that it lies between; rows are sorted."""
    place = share * (len(rows) - 1)
    low = int(place)
    part = place - low
    above = rows[min(low + 1, len(rows) - 1)].tolist()
    return [one + part * (next_one - one) for one, next_one in zip(rows[low].tolist(), above, strict=True)]
