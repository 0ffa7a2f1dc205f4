"""What tuning asks of a task: objectives drawn from ranges that leave out what the evaluation asks.

Training never sees them: they choose between states of one policy, `export.training.validation`. Time limits
and tolerances are the task's own, guidance is as the packaged fleet has it.
"""

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from msgspec import structs

from edge_runtime.config.fleet import FLEETS, load_fleet
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.objectives import (
    Clustering,
    Geofence,
    Objective,
    Passing,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
)
from export.scenarios.definitions import DEFINITIONS, Definition

Asked = TypeVar("Asked", bound=Objective)

SHARE_AROUND = 0.08
"""Of a number of the evaluation: values nearer than this are left out."""
SWAPS = 3
"""Neighbours that change places, one pair after the other, at most."""
FENCE_M = (0.2, 0.6)
"""Distance of a fence's centre from the middle of the field, where the evaluation's stands."""


@dataclass(frozen=True)
class Varied:
    """A task that asks for something else."""

    definition: Definition
    """What is judged."""
    asked: ObjectiveSet
    """What guides."""


def varied(task: str, seed: int) -> Varied:
    """Draw a task's objectives anew.

    Args:
        task: its name.
        seed: of what is drawn.
    """
    draw, definition = np.random.default_rng(seed), DEFINITIONS[task]
    drawn = {
        field.name: _vary(value, draw)
        for field in fields(definition)
        if isinstance(value := getattr(definition, field.name), Objective)
    }
    fleet = load_fleet(FLEETS / f"{task}.toml").objective_set
    guiding = tuple(_as_drawn(each, tuple(drawn.values())) for each in fleet.objectives)
    return Varied(replace(definition, **drawn), ObjectiveSet(guiding, fleet.guidance))


def _vary(objective: Asked, draw: np.random.Generator) -> Asked:
    """Give an objective of a definition other numbers.

    Raises:
        TypeError: if nobody has said within which ranges.
    """
    changed: dict[str, object]
    if isinstance(objective, SpeedLimit):
        changed = {"limit_m_s": _beside(objective.limit_m_s, 0.26, 0.4, draw)}
    elif isinstance(objective, SafetyMargin):
        changed = {"distance_m": _beside(objective.distance_m, 0.22, 0.3, draw)}
    elif isinstance(objective, SpatialOrder):
        changed = {
            "order": _other_order(objective.order, draw),
            "gap_m": _beside(objective.gap_m, 0.06, 0.1, draw),
        }
    elif isinstance(objective, Spacing):
        changed = {"distance_m": _beside(objective.distance_m, 0.12, 0.18, draw)}
    elif isinstance(objective, Geofence):
        angle, distance = draw.uniform(0, 2 * np.pi), draw.uniform(*FENCE_M)
        changed = {
            "centre_m": (float(distance * np.cos(angle)), float(distance * np.sin(angle))),
            "radius_m": _beside(objective.radius_m, 0.2, 0.4, draw),
        }
    elif isinstance(objective, Clustering):
        changed = {"radius_m": _beside(objective.radius_m, 0.15, 0.26, draw)}
    else:
        raise TypeError(f"no ranges are known for {type(objective).__name__}")
    return structs.replace(objective, **changed)


def _as_drawn(guiding: Objective, drawn: tuple[Objective, ...]) -> Objective:
    """What a fleet's objective becomes when its task asks for something else."""
    for each in drawn:
        if type(each) is type(guiding):
            return structs.replace(each, look_ahead=guiding.look_ahead)
        if isinstance(guiding, Passing) and isinstance(each, SpatialOrder):
            return structs.replace(guiding, order=each.order)
    return guiding


def _beside(avoided: float, low: float, high: float, draw: np.random.Generator) -> float:
    """Draw uniformly from a range less what is near ``avoided``."""
    ends = (low, (1 - SHARE_AROUND) * avoided), ((1 + SHARE_AROUND) * avoided, high)
    below, above = (max(end - start, 0.0) for start, end in ends)
    where = draw.uniform(0.0, below + above)
    return float(low + where if where < below else high - (below + above - where))


def _other_order(avoided: tuple[int, ...], draw: np.random.Generator) -> tuple[int, ...]:
    """Let neighbours of the robots' first order change places, until it is none but a new one."""
    while True:
        order = sorted(avoided)
        for first in draw.integers(0, len(order) - 1, draw.integers(1, SWAPS + 1)):
            order[first], order[first + 1] = order[first + 1], order[first]
        if tuple(order) != avoided and order != sorted(avoided):
            return tuple(order)
