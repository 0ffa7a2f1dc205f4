"""When a tick begins: with the pose that it acts on, or at its deadline where no pose is to be expected.

Between two deadlines lies one period, and between them lies one tick: it begins at its deadline if a pose has
just arrived, else with the first one to arrive after it, `PATIENCE` of a period later at the latest. So
nothing that a source does makes more ticks than there are deadlines, nor fewer. Where every pose comes long
after a deadline, the deadlines follow, by small steps that the grid allows.
"""

import math
import select
import time
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from edge_runtime.control.rate import DeadlineGrid
from edge_runtime.control.rhythm import Rhythm

PATIENCE: Final = 0.5
"""Share of a period that a tick waits for its pose at most; two ticks are never nearer than the rest."""
FRESH: Final = 0.05
"""Share of a period: a pose that came so shortly before the deadline is the tick's."""
KEPT: Final = 2.5 * FRESH
"""The same after a tick that began at its deadline so. Poses that come several to a period, about `FRESH`
before it, would else be fresh for one tick and too old for the next, which would wait for another."""
TOGETHER: Final = 0.1
"""Share of a period: poses that come within it count as one for the source's rhythm."""
JUDGED: Final = 5
"""Ticks that tell whether deadlines come too early."""
BUSY: Final = 0.8
"""Share of a period by whose end a tick that has waited must be done."""


WAKING_S: Final = 0.3e-3
"""A sleep may end so late."""
COLD: Final = 4.0
"""After a sleep everything takes up to so many times as long."""
MOST_LEAD: Final = 0.1
"""Share of a period that preparing may take to pay."""


class PoseSource(Protocol):
    """Where the poses come from on which a robot's ticks act."""

    def fileno(self) -> int:
        """Return the descriptor that is readable when a pose may have arrived."""
        ...

    def new_poses(self) -> Sequence[float]:
        """Take in what has arrived; returns when each pose was measured that came since the last call."""
        ...


def lead_for(prepare: Callable[[], object], period_s: float) -> float:
    """Return how long before a tick to ``prepare`` for it; 0 where that takes too much of a period to pay."""
    prepare()  # once to load what it needs
    begin_s = time.perf_counter()
    prepare()
    lead_s = WAKING_S + COLD * (time.perf_counter() - begin_s)
    return lead_s if lead_s < MOST_LEAD * period_s else 0.0


class StateGrid(DeadlineGrid):
    """A deadline grid whose ticks begin with a pose.

    Args:
        period_s: distance between deadlines.
        source: tells the poses; None where one is always there: ticks begin at their deadlines.
        prepare: called ``lead_s`` before a tick is expected to begin, for what can be done by then; it must
            leave no trace.
        lead_s: longer than that takes; 0: not at all; None: as `lead_for` finds after the first tick.
        longest_gap_s: two ticks may be so far apart that the robot's guard does not mind.
        clock: monotonic time in seconds.
        sleep: waits for a number of seconds; may return late.
        listen: waits until the source is readable, or for a number of seconds.
    """

    def __init__(
        self,
        period_s: float,
        source: PoseSource | None,
        prepare: Callable[[], object] = lambda: None,
        lead_s: float | None = 0.0,
        longest_gap_s: float = math.inf,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        listen: Callable[[PoseSource, float], object] = lambda source, s: select.select((source,), (), (), s),
    ) -> None:
        super().__init__(period_s, clock, sleep)
        self._source, self._prepare, self._lead_s, self._listen = source, prepare, lead_s, listen
        self._patience_s = min(PATIENCE * period_s, 0.5 * (longest_gap_s - period_s))
        self._punctual = False
        """Whether the last tick began at its deadline, with a fresh pose."""
        self._rhythm = Rhythm(TOGETHER * period_s)
        self._late_s: list[float] = []
        self._begun_s, self._busy_s = math.inf, 0.0

    def wait(self) -> float:
        """Wait until the next tick is to begin and return its deadline; see `DeadlineGrid.wait`."""
        self._busy_s = max(0.9 * self._busy_s, self._clock() - self._begun_s)
        if self._lead_s is None and self.ticks:
            self._lead_s = lead_for(self._prepare, self.period_s)
        deadline_s = super().wait()
        self._begun_s = self._clock()
        return deadline_s

    def _reach(self, deadline_s: float) -> None:
        """Wait for the tick's pose, or for its deadline where none is expected in time."""
        self._look()
        kept = self._punctual and self._rhythm.repeats(self.period_s)
        fresh_s = (KEPT if kept else FRESH) * self.period_s
        patience_s = max(0.0, min(self._patience_s, BUSY * self.period_s - self._busy_s))
        waited = self._await_pose(deadline_s - fresh_s, deadline_s, deadline_s + patience_s)
        early_s = deadline_s - self._rhythm.newest_s
        self._punctual = -FRESH * self.period_s <= early_s <= fresh_s
        if waited:
            self.due_s = max(deadline_s, self._rhythm.newest_s)
        self._follow(self._pose_s(deadline_s - fresh_s) - deadline_s)

    def _await_pose(self, after_s: float, deadline_s: float, last_s: float) -> bool:
        """Wait for the deadline and for a pose measured after a time; whether any was waited for.

        What is expected is judged anew with each pose that comes, which may be sooner or later than thought.
        """
        lead_s, waited = self._lead_s or 0.0, False
        while True:
            begin_s, end_s = self._expect(after_s, deadline_s, last_s)
            waited, now_s = waited or end_s > deadline_s, self._clock()
            if now_s >= end_s:
                return waited
            until_s = begin_s - lead_s if lead_s else end_s
            if now_s < until_s:
                self._pass(until_s - now_s, after_s - now_s)
            else:  # late for it, in vain: what is still cold then delays less than preparing would
                if now_s < begin_s - 0.5 * lead_s:
                    self._prepare()
                lead_s = 0.0
            self._look()

    def _expect(self, after_s: float, deadline_s: float, last_s: float) -> tuple[float, float]:
        """Return when the tick is likely to begin, and when it begins at the latest."""
        pose_s = self._pose_s(after_s)
        if self._rhythm.newest_s >= after_s or pose_s > last_s:
            return deadline_s, deadline_s
        return max(pose_s, deadline_s), last_s

    def _pass(self, until_s: float, after_s: float) -> None:
        """Wait for so long, or until something comes that matters: nothing does before the second time."""
        if self._source and after_s <= 0.0:
            self._listen(self._source, until_s)
        else:
            self._sleep(min(until_s, after_s) if self._source else until_s)

    def _pose_s(self, after_s: float) -> float:
        """Return when the first pose after a time was measured, or when it is expected."""
        newest_s = self._rhythm.newest_s
        return newest_s if newest_s >= after_s else self._rhythm.next_s(after_s, self._clock())

    def _follow(self, late_s: float) -> None:
        """Where every pose comes so late that patience might not last, have the deadlines put off."""
        if self._wish_s <= 0.0:
            self._late_s.append(late_s)
        if len(self._late_s) == JUDGED:
            least_s = min(self._late_s)
            if least_s < self.period_s:
                self._wish_s = max(0.0, least_s - 0.5 * self._patience_s)
            self._late_s.clear()

    def _look(self) -> None:
        for pose_s in self._source.new_poses() if self._source else ():
            self._rhythm.heard(pose_s)
