"""What robots believe of the field that they sample, by what each of them can know, and where it draws them.

A robot knows its own readings (the values one cell away, of cells that nobody has emptied) and where it and
its teammates have been: what they passed is empty. The rest is the mean of its guesses of where bumps lie.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.messages import TeamState, Vector
from edge_runtime.observation.belief import Belief
from export.beliefs.field_guesses import HALF_WIDTH_M, FieldGuesses

CELL_M = 0.05
CELLS = round(2 * HALF_WIDTH_M / CELL_M)
"""Along each axis."""
WALL_M = 0.975
"""The robots' centres stay within a square of this half-width."""
WINDOW_M = 0.2
"""What a team there would gather lies within about so much."""
SPEED_M_S, STAY_S = 0.4, 2.0
"""What is gathered there is set against the time: of the way, and of a stay."""
Disc = tuple[float, float, float]
"""x, y and radius in m."""
PAUSE = 5
"""Ticks from one reading, and one choice of a place, to the next: a cell's width apart."""
AROUND_M = CELL_M * np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (-1, -1), (1, -1), (-1, 1), (1, 1)])
"""Where ``nearby_samples`` are read, from the robot."""

_CELL = (np.arange(CELLS) + 0.5) * CELL_M - HALF_WIDTH_M
_PLACE = _CELL[1::2] - 0.5 * CELL_M
_GATHERED = np.exp(np.square(_PLACE[:, None] - _CELL) / (-2.0 * WINDOW_M**2))
_PLACES = np.stack(np.meshgrid(_PLACE, _PLACE, indexing="ij"), -1).reshape(-1, 2)


def _within(closed: Sequence[Disc]) -> npt.NDArray[np.bool_]:
    """The cells (40, 40) inside of zones."""
    cells = np.stack(np.meshgrid(_CELL, _CELL, indexing="ij"), -1)
    inside = [np.linalg.norm(cells - (x, y), axis=-1) < radius_m for x, y, radius_m in closed]
    return np.any(inside, 0) if inside else np.zeros((CELLS, CELLS), bool)


class SampleBelief:
    """The beliefs of B robots, each for itself.

    Args:
        robots: B.
        closed: where nobody may go, and nothing is to be gathered.
    """

    def __init__(self, robots: int, closed: Sequence[Disc] = ()) -> None:
        self._rows = np.arange(robots)[:, None]
        self._guesses = FieldGuesses(robots)
        self._ticks, self._best_m = 0, np.zeros((robots, 2))
        self._empty = np.tile(_within(closed), (robots, 1, 1))

    def follow(self, own_m: Floats, mates_m: Floats, readings: Floats) -> Floats:
        """Take one tick in; where most is to be gathered for the time that it takes.

        Args:
            own_m: (B, 2)
            mates_m: (B, K, 2)
            readings: (B, 8), as the policy observes them.

        Returns:
            (B, 2)
        """
        team_m = np.concatenate([own_m[:, None], mates_m], 1)
        self._pass(team_m)
        if self._ticks % PAUSE == 0:
            self._guesses.read(np.clip(own_m[:, None] + AROUND_M, -WALL_M, WALL_M), readings)
            self._best_m = self._choose(team_m.mean(1))
        self._ticks += 1
        return self._best_m

    def left(self) -> Floats:
        """What each cell is believed to hold (B, 40, 40), by x, then y."""
        return np.where(self._empty, 0.0, self._guesses.expected(_CELL))

    def _pass(self, place_m: Floats) -> None:
        """Empty the cells at (B, N, 2)."""
        cell = (np.clip(place_m, -WALL_M, WALL_M) / CELL_M + CELLS / 2).astype(np.int64)
        self._empty[self._rows, cell[..., 0], cell[..., 1]] = True

    def _choose(self, middle_m: Floats) -> Floats:
        """The place (B, 2) of the greatest gain a second, for teams around (B, 2)."""
        gathered = (_GATHERED @ self.left() @ _GATHERED.T).reshape(len(middle_m), -1)
        way = np.linalg.norm(_PLACES - middle_m[:, None], axis=-1)
        best: Floats = _PLACES[(gathered / (way / SPEED_M_S + STAY_S)).argmax(1)]
        return best


class Richest(Belief):
    """Where one robot believes most to be left, for a fleet file's ``[[belief]]``.

    Args:
        closed: where nobody may go.
    """

    def __init__(self, closed: Sequence[Disc] = ()) -> None:
        self._belief = SampleBelief(1, closed)

    def follow(self, team: TeamState) -> Vector | None:
        """Take one tick in; None where nobody has read anything."""
        readings = [each.values for each in team.readings if each.sensor == "nearby_samples"]
        if not readings:
            return None
        mates_m = np.array([mate.state.position_m for mate in team.teammates]).reshape(1, -1, 2)
        (place,) = self._belief.follow(np.array([team.own.position_m]), mates_m, np.array(readings)).tolist()
        return tuple(place)
