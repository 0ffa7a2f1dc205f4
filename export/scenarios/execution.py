"""What each task's robots are asked at execution time: Table I's objectives, the same for every method."""

from edge_runtime.objectives import Objective
from export.scenarios.definitions import BALANCE, NAVIGATION, SAMPLING

EXECUTION_OBJECTIVES: dict[str, tuple[Objective, ...]] = {
    "balance": BALANCE.objectives,
    "navigation": NAVIGATION.objectives,
    "sampling": SAMPLING.objectives,
}
"""By scenario: the individual's objective, then the team's."""

NOMINAL_STEP: dict[str, float] = {"balance": 0.5, "navigation": 0.3, "sampling": 0.85}
"""Nominal reward of a robot in one step that PC-MAPPO weighs like the grossest violation.

On Navigation 0.3 kept to the objectives, where 0.1, the pay of a robot at its goal, sped; elsewhere it is
what a good policy earns in a step, untuned.
"""
