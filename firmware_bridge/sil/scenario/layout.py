"""Where a generated team stands and where it goes: feasible for discs that keep a margin."""

import itertools
import math
from typing import NamedTuple

from edge_runtime.messages import Vector2

RADIUS_M = 0.9
"""Of the circle on which small teams start: inside the arena of the packaged policy's training."""
LEAST_GAP_M = 0.32
"""Between neighbours' centres when all are nearest to the middle; the margin asked for is 0.25 m."""
LONGEST_TURN_RAD = math.radians(150.0)
CELL_M = 0.4
"""Of the grid for teams that do not fit on the circle."""


class Place(NamedTuple):
    """One robot's start and goal."""

    start_m: Vector2
    goal_m: Vector2


def places(robots: int) -> tuple[Place, ...]:
    """Return starts and goals: around a circle while its chords leave room, else one cell along a snake."""
    if robots == 1:
        return (Place((-RADIUS_M, 0.0), (RADIUS_M, 0.0)),)
    # Robots that turn by the same angle form a shrinking and growing polygon: its least side is what counts.
    needed = LEAST_GAP_M / (2.0 * RADIUS_M * math.sin(math.pi / robots))
    if needed > 0.9:
        return _snake(robots)
    turn = min(2.0 * math.acos(needed), LONGEST_TURN_RAD)
    return tuple(
        Place(_on_circle(math.tau * index / robots), _on_circle(math.tau * index / robots + turn))
        for index in range(robots)
    )


def _on_circle(angle_rad: float) -> Vector2:
    return round(RADIUS_M * math.cos(angle_rad), 4), round(RADIUS_M * math.sin(angle_rad), 4)


def _snake(robots: int) -> tuple[Place, ...]:
    columns = math.ceil(math.sqrt(robots + 1))
    middle = (columns - 1) / 2
    cells = [
        (CELL_M * (column - middle if row % 2 == 0 else middle - column), CELL_M * (row - middle))
        for row, column in itertools.product(range(columns), repeat=2)
    ]
    rounded = [(round(x, 4), round(y, 4)) for x, y in cells]
    return tuple(Place(*pair) for pair in itertools.pairwise(rounded[: robots + 1]))
