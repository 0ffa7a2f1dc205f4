"""How a set of objectives was kept over its own time."""

import math
from collections import Counter

import msgspec

from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import TeamState

SETTLE_S = 2.0
"""After a change of objectives robots must first brake or part: they are judged by the new ones from then."""


class Judgement(msgspec.Struct, frozen=True):
    """What was seen while one set of objectives was judged."""

    version: int
    """Of the set; 0 is what the run was started with."""
    judged_s: float
    """For how long; 0 where it held for less than `SETTLE_S`."""
    min_separation_m: float | None
    """Least distance between any two centres; None if no other robot was seen."""
    safety_margin_m: float | None
    """What the set asks of it, guided or not."""
    max_speed_m_s: float
    """Greatest speed of any robot."""
    speed_limit_m_s: float | None
    silent_s: dict[int, float]
    """How long each robot was masked meanwhile: what it did then is in none of these figures."""


class Judging:
    """Follows the team while one set of objectives holds.

    Args:
        asked: the set.
        version: of it.
        since_s: when its time begins.
    """

    def __init__(self, asked: ObjectiveSet, version: int = 0, since_s: float = -math.inf) -> None:
        self._asked, self._version, self._since_s = asked, version, since_s
        self._ticks, self._separation_m, self._speed_m_s = 0, math.inf, 0.0
        self._silent_ticks: Counter[int] = Counter()

    def follow(self, team: TeamState, separation_m: float, speed_m_s: float) -> None:
        """Take one tick into account: the least distance between two centres then, and the greatest speed."""
        if team.own.stamp_s < self._since_s:
            return
        self._ticks += 1
        self._silent_ticks.update(mate.state.robot_id for mate in team.silent)
        self._separation_m = min(self._separation_m, separation_m)
        self._speed_m_s = max(self._speed_m_s, speed_m_s)

    def judgement(self, period_s: float) -> Judgement:
        """Return what was seen so far; ``period_s`` is a tick's length."""
        return Judgement(
            version=self._version,
            judged_s=self._ticks * period_s,
            min_separation_m=self._separation_m if math.isfinite(self._separation_m) else None,
            safety_margin_m=self._asked.margin_m,
            max_speed_m_s=self._speed_m_s,
            speed_limit_m_s=self._asked.speed_limit_m_s,
            silent_s={robot: ticks * period_s for robot, ticks in self._silent_ticks.items()},
        )
