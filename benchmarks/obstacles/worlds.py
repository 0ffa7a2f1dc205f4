"""Worlds to drive through: four robots' ways across an arena with pillars, which two people cross as well."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from edge_runtime.config.fleet import Fleet, Obstacle, Team
from edge_runtime.config.network import Robot
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import Vector2

ROBOTS: Final = 4
PILLARS: Final = 5
WALKERS: Final = 2
RADIUS_M: Final = 0.1
"""Of pillars and walkers; of the robots too."""
WALKER_M_S: Final = 0.15
"""Half as fast as the robots may be."""
WALK_FROM_M: Final = 2.0
"""How far from the middle a walker sets out."""
ARENA_M: Final = 1.2
"""Starts and goals lie in a square of this half-width."""
PILLARS_M: Final = 0.9
"""Pillars in one of this."""
PILLARS_APART_M: Final = 0.7
FROM_PILLAR_M: Final = 0.55
"""Starts and goals: farther than the range sensor sees, so that the policy can rest at its goal."""
STARTS_APART_M: Final = 0.5
GOALS_APART_M: Final = 0.6
WALK_CLEAR_M: Final = 0.4
"""A walker's line from every pillar: nobody is crushed between the two."""
_TRIES: Final = 500


def world(seed: int, asked: ObjectiveSet) -> Fleet:
    """Draw the world of a seed, with a team that follows ``asked``."""
    draw = np.random.default_rng(seed)
    while True:
        pillars = scattered(draw, PILLARS, PILLARS_M, PILLARS_APART_M)
        starts = scattered(draw, ROBOTS, ARENA_M, STARTS_APART_M, pillars)
        goals = scattered(draw, ROBOTS, ARENA_M, GOALS_APART_M, pillars)
        walkers = [walker for _ in range(_TRIES) if (walker := _walker(draw, pillars))][:WALKERS]
        if pillars and starts and goals and len(walkers) == WALKERS:
            break
    robots = tuple(Robot(i, start, goal) for i, (start, goal) in enumerate(zip(starts, goals, strict=True)))
    obstacles = (*(Obstacle(pillar, RADIUS_M) for pillar in pillars), *walkers)
    return Fleet(Path(f"world {seed}"), Team(), robots, asked, obstacles=obstacles)


def scattered(
    draw: np.random.Generator, count: int, half_m: float, apart_m: float, pillars: Sequence[Vector2] = ()
) -> list[Vector2]:
    """Places in a square, apart from each other and from pillars; none where there is no room for all."""
    places: list[Vector2] = []
    for x, y in draw.uniform(-half_m, half_m, (_TRIES, 2)).tolist():
        free = all(math.dist((x, y), other) >= apart_m for other in places)
        if free and all(math.dist((x, y), pillar) >= FROM_PILLAR_M for pillar in pillars):
            places.append((x, y))
        if len(places) == count:
            return places
    return []


def _walker(draw: np.random.Generator, pillars: Sequence[Vector2]) -> Obstacle | None:
    """Somebody who crosses the arena straight ahead; None where a pillar is too near the way."""
    angle, aside = draw.uniform(0.0, 2.0 * math.pi), draw.uniform(-1.0, 1.0)
    x, y = math.cos(angle), math.sin(angle)
    if any(abs(py * x - px * y - aside) < WALK_CLEAR_M for px, py in pillars):
        return None
    centre = (-WALK_FROM_M * x - aside * y, -WALK_FROM_M * y + aside * x)
    return Obstacle(centre, RADIUS_M, (WALKER_M_S * x, WALKER_M_S * y))
