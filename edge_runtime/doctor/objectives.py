"""Checks of a user's own objectives: does each slope belong to its cost?"""

import math
from collections.abc import Iterator
from functools import partial
from typing import Final

from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, examine, ok, warn
from edge_runtime.objectives import BUILT_IN, Objective
from edge_runtime.objectives.gradient_check import sample_gradient

NEAR_M: Final = 0.4
"""Half-width of the first square that robots are drawn from; the second one holds all starts and goals."""


def examine_objectives(mission: Mission) -> Iterator[Finding]:
    """Compare the slopes of the mission's own objectives with finite differences."""
    for objective in mission.objective_set.objectives:
        if type(objective) not in BUILT_IN:
            yield examine("gradient", partial(gradient, objective, mission))


def gradient(objective: Objective, mission: Mission) -> Finding:
    """Whether an objective's slope is right wherever it is active.

    Raises:
        GradientError: if it is not, or the objective raises.
    """
    places = (place for robot in mission.fleet.robots for place in (*robot.start_m, *(robot.goal_m or ())))
    arena_m = max(map(math.fabs, places))
    active = motions = 0
    for extent_m in {NEAR_M, max(arena_m, NEAR_M)}:
        report = sample_gradient(objective, mission.bundle.manifest.motion, extent_m=extent_m)
        active, motions = active + report.active, motions + report.motions
    if not active:
        return warn(
            f"{objective.name} was never active at {motions} random motions",
            "call check_gradient with an extent_m at which it is",
        )
    return ok(f"{objective.name}: slope and cost agree at {motions} random motions, active at {active}")
